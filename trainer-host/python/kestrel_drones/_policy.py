"""Trained policies."""

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from . import _native, _tasks
from ._tasks import SHIPPED


class Policy:
    """A policy file, which acts with the very inference that firmware runs, bit for bit."""

    def __init__(self, native):
        self.native = native

    @classmethod
    def load(cls, path):
        """The policy of a file, of a run directory (fixed point), or one that is shipped: ``hover``, ``cross``."""
        path = Path(os.fspath(path))
        shipped = SHIPPED / "assets" / "pilots" / f"{path}.kestrel"
        if path.is_dir():
            path = path / "policy.kestrel"
        elif not path.exists() and shipped.exists():
            path = shipped
        return cls(_native.Policy.load(path))

    @property
    def name(self):
        """Name of the experiment that it was trained in."""
        return self.native.name

    @property
    def arithmetic(self):
        """``fixed16`` or ``float32``."""
        return self.native.arithmetic

    @property
    def control_secs(self):
        """Time from one action to the next [s]."""
        return self.native.control_secs

    @property
    def airframe(self):
        """The drone that it learned to fly, ``None`` if its file is older.

        A dictionary: ``mass_kg``, ``rotor_thrust_limit_n``, ``rotor_positions_m`` (forward and left of each rotor) and
        ``torque_per_thrust_m`` (negative where a rotor turns counter-clockwise).
        """
        return self.native.airframe

    @property
    def is_recurrent(self):
        """Whether it acts on what it remembers."""
        return self.native.is_recurrent

    def memory(self, rows=1):
        """What a recurrent policy remembers of ``rows`` flights: empty. ``memory.clear(terminated | truncated)`` begins
        those anew whose episodes have ended."""
        return _native.Memory(rows)

    def act(self, observation, memory=None):
        """The action for an observation, or one for each row of many: an array, or a dictionary with the images.

        A recurrent policy takes the observations into its ``memory`` and acts on that.
        """
        images = None
        if isinstance(observation, dict):
            observation, images = observation["observation"], np.asarray(observation["image"], dtype=np.uint8)
        values = np.asarray(observation, dtype=np.float32)
        if values.ndim == 1:
            images = None if images is None else images[None]
            return self.native.act(values[None], images, memory)[0]
        return self.native.act(values, images, memory)

    def __repr__(self):
        return f"Policy({self.name}, {self.arithmetic})"


def import_policy(network, task, *, activation=None, output_activation=None, out=None, **set):
    """The policy, in fixed point, of a multilayer perceptron that another program trained for a task.

    ``network`` is the path of an ONNX or safetensors file, or a state dict: names and arrays of ``float32`` (PyTorch's
    tensors, numpy, JAX). ``activation`` (``tanh``, ``relu``) and ``output_activation`` (``none``, ``tanh``) say what names
    of weights do not tell. ``out`` names a new directory for what ``kestrel import`` writes: a run that ``Run(out)`` opens.
    """
    found = _state_dict(network) if isinstance(network, Mapping) else os.fspath(network)
    assumed = (activation, output_activation)
    return Policy(_native.import_policy(found, _tasks.load(task, set), assumed, out))


def _state_dict(arrays):
    tensors = _native.StateDict()
    for name, array in arrays.items():
        array = np.asarray(array.detach().cpu() if hasattr(array, "detach") else array)
        if array.dtype == np.float32:
            tensors.insert(name, np.ascontiguousarray(array))
        else:
            tensors.insert_other(name, str(array.dtype))
    return tensors
