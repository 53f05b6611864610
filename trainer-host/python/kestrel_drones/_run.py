"""Training runs, as ``kestrel train``, ``evaluate`` and ``export`` make and read them."""

import base64
import json
import os
import sys
from dataclasses import dataclass
from pathlib import Path

from . import _native, _tasks
from ._policy import Policy


@dataclass(frozen=True)
class Run:
    """A run directory: configuration, metrics, checkpoints, learning curve, policies, evaluation and a flight as GIF."""

    path: Path

    @property
    def rows(self):
        """The learning curve: a dictionary per update, which ``pandas.DataFrame(run.rows)`` takes."""
        with open(self.path / "metrics.jsonl", encoding="utf-8") as lines:
            return [json.loads(line) for line in lines if line.endswith("\n")]

    @property
    def policy(self):
        """The best policy, in fixed point."""
        return Policy.load(self.path)

    @property
    def evaluation(self):
        """How it flew beside the baselines: ``rows`` with ``pilot``, ``success_rate``, ``episode_return`` and more."""
        return json.loads((self.path / "evaluation.json").read_text(encoding="utf-8"))

    @property
    def curve(self):
        """The learning curve so far, as SVG."""
        return _native.learning_curve(self.path)

    @property
    def film(self):
        """The flight from the first start of its evaluation, which a notebook shows."""
        return Film(self.path / "flight.gif")

    def _repr_html_(self):
        """The learning curve in a notebook."""
        return self.curve if self.rows else None


@dataclass(frozen=True)
class Film:
    """A flight as GIF."""

    path: Path

    def _repr_html_(self):
        """The film in a notebook."""
        picture = base64.b64encode(self.path.read_bytes()).decode()
        return f'<img alt="a flight" src="data:image/gif;base64,{picture}">'


def train(config, *, seed=None, out=None, threads=None, watch=None, **set):
    """Trains a policy and returns the run, whose directory is ``out``, or the next free one in ``runs``.

    ``config`` and further keywords are those of ``DroneVectorEnv``: ``train("cross", training={"total_steps": 1_000_000})``.
    ``watch`` is called with the run twice a second; in a notebook it draws the learning curve as it grows, unless it is
    given or ``False``.
    Ctrl-C stops after the update in progress, with a checkpoint from which ``resume`` goes on; so does an exception of ``watch``.
    """
    overrides = _tasks.overrides(set) + ([] if seed is None else [f"training.seed={seed}"])
    watch = _live_curve() if watch is None else watch
    tell = (lambda path: watch(Run(Path(path)))) if watch else None
    return Run(Path(_native.train(_tasks.source(config), overrides, (out, threads), tell)))


def _live_curve():
    """Draws the curve of a run where Jupyter shows it; nothing elsewhere."""
    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    if not hasattr(shell, "kernel"):
        return None
    from IPython.display import HTML, display

    shown = display(HTML("<p>It begins.</p>"), display_id=True)
    return lambda run: shown.update(HTML(run.curve)) if run.rows else None


def resume(run, *, threads=None):
    """Goes on with a run that was stopped."""
    return Run(Path(_native.resume(_directory(run), threads)))


def evaluate(run, *, episodes=None, seed=None, threads=None):
    """Flies a run's policies and the baselines from the starts of its evaluation; returns the report."""
    keys = {"evaluation.episodes": episodes, "evaluation.seed": seed}
    overrides = [f"{key}={value}" for key, value in keys.items() if value is not None]
    return json.loads(Path(_native.evaluate(_directory(run), overrides, threads)).read_text(encoding="utf-8"))


def export(run, target="file"):
    """Exports a run's policy and returns the paths; ``target`` is file, rust, c, crazyflie, betaflight, onnx or
    safetensors."""
    return [Path(path) for path in _native.export(_directory(run), target)]


def _directory(run):
    return run.path if isinstance(run, Run) else Path(os.fspath(run))
