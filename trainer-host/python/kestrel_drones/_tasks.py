"""Shipped tasks by name, and configurations as the native half reads them."""

import difflib
import functools
import json
import os
from collections.abc import Mapping
from pathlib import Path

import gymnasium
import numpy as np
from gymnasium import spaces

from ._native import KestrelError, Task, use_library

SHIPPED = Path(__file__).parent / "shipped"
# Configurations of others may say `import: kestrel:configs/hover.yaml`.
use_library(str(SHIPPED))

# In the order in which names are given: an aviary whose name is taken is called `aviaries/NAME`.
FOLDERS = ["configs", "configs/aviaries", "configs/aviaries/stream"]

# Tasks of several drones, which gymnasium has no environments for.
TEAMS = {
    "crossing-3",
    "flock",
    "flock-as-published",
    "forest-team",
    "leader-follower",
    "leader-follower-as-published",
    "meetup",
    "meetup-as-published",
    "multi-cross",
    "multi-cross-as-published",
    "multi-hover",
    "multi-hover-as-published",
    "swarm",
}


@functools.cache
def task_paths():
    """The shipped tasks: name and path of the YAML file. Files with several tasks are for the command line."""
    paths = {}
    for folder in FOLDERS:
        for path in sorted((SHIPPED / folder).glob("*.yaml")):
            if "\ntasks:" in path.read_text(encoding="utf-8"):
                continue
            name = path.stem if path.stem not in paths else f"{path.parent.name}/{path.stem}"
            paths[name] = path
    return paths


def task_path(name):
    """The YAML file of a shipped task, to be imported by a configuration of your own."""
    if name not in task_paths():
        raise KestrelError(f"{name}: found no such task, expected {_nearest(name)}")
    return task_paths()[name]


def airframe_path(name):
    """The YAML file of a shipped drone: ``**{"scenario.vehicle.airframe": {"import": str(airframe_path("x500"))}}``."""
    path = SHIPPED / "assets" / "airframes" / f"{name}.yaml"
    if not path.exists():
        shipped = ", ".join(sorted(file.stem for file in path.parent.glob("*.yaml")))
        raise KestrelError(f"{name}: found no such airframe, expected {shipped}")
    return path


def _nearest(name):
    near = difflib.get_close_matches(name, task_paths(), n=3, cutoff=0.4)
    return f"a YAML file or the name of a task, such as {', '.join(near or ['hover', 'cross', 'room-1'])}"


def source(config):
    """Name and text of a configuration; no text where the name is the path of a file."""
    if isinstance(config, Mapping):
        return "configuration", json.dumps(config)
    name = os.fspath(config)
    if not os.path.exists(name) and not name.endswith((".yaml", ".yml")):
        return str(task_path(name)), None
    return name, None


def overrides(keywords):
    """Keywords as overrides: ``training={"epochs": 3}`` lays keys over others, ``**{"scenario.action": ...}`` replaces."""
    assignments = []
    for key, value in keywords.items():
        if isinstance(value, Mapping) and "." not in key:
            assignments += [f"{key}.{assignment}" for assignment in overrides(value)]
        else:
            assignments.append(f"{key}={json.dumps(value)}")
    return assignments


def load(config, keywords):
    """The task of a name, a path or a dictionary."""
    return Task(*source(config), overrides(keywords))


def task_id(name):
    """The name of a task in gymnasium's registry: ``room-1`` is ``kestrel/Room1-v0``."""
    words = name.replace("/", "-").split("-")
    return f"kestrel/{''.join(word[:1].upper() + word[1:] for word in words)}-v0"


def task_ids():
    """Names of the shipped tasks of one drone in gymnasium's registry."""
    return [task_id(name) for name in task_paths() if name not in TEAMS]


def register():
    """Registers the shipped tasks of one drone with gymnasium."""
    for name in task_paths():
        if name not in TEAMS and task_id(name) not in gymnasium.registry:
            gymnasium.register(
                task_id(name),
                entry_point="kestrel_drones:DroneEnv",
                vector_entry_point="kestrel_drones:DroneVectorEnv",
                kwargs={"config": name},
            )


def observation_space(task):
    """Values of order one, and the image beside them if the task has one."""
    values = spaces.Box(-np.inf, np.inf, (task.observation_len,), np.float32)
    if task.image is None:
        return values
    return spaces.Dict({"observation": values, "image": spaces.Box(0, 255, tuple(task.image), np.uint8)})


def action_space(task):
    """Every value in [-1, 1]."""
    return spaces.Box(-1.0, 1.0, (task.action_len,), np.float32)


# Rows and columns of what render() returns.
RENDER_SIZE = [240, 320]


def refuse_other_mode(render_mode):
    """There are pictures, and no window."""
    if render_mode not in (None, "rgb_array"):
        raise KestrelError(f"render_mode: found {render_mode}, expected rgb_array or None")


def refuse_team(task):
    """A team needs PettingZoo's interface."""
    if task.agents > 1:
        raise KestrelError(
            f"{task.name}: found a team of {task.agents} drones, expected one drone: use kestrel_drones.parallel_env"
        )
