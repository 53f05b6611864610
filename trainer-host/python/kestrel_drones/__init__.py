"""Kestrel from Python: reinforcement learning for quadrotors.

>>> import kestrel_drones
>>> envs = kestrel_drones.make_vec("hover", num_envs=1024)
>>> run = kestrel_drones.train("hover", seed=0)
>>> actions = run.policy.act(envs.reset(seed=0)[0])

Importing the package registers every shipped task of one drone with gymnasium: ``gymnasium.make_vec("kestrel/Room1-v0",
num_envs=1024)``. Teams are PettingZoo's: ``kestrel_drones.parallel_env("multi-hover")``.
"""

from ._native import KestrelError, __version__
from ._tasks import airframe_path, register, task_ids, task_path, task_paths
from ._controller import Controller
from ._env import DroneEnv
from ._policy import Policy, import_policy
from ._run import Run, evaluate, export, resume, train
from ._study import Study
from ._vector_env import DroneVectorEnv

make = DroneEnv
make_vec = DroneVectorEnv


def parallel_env(config, **keywords):
    """A team's task as PettingZoo's ``ParallelEnv``; needs ``pip install kestrel-drones[teams]``."""
    from ._parallel_env import DroneParallelEnv

    return DroneParallelEnv(config, **keywords)


register()

__all__ = [
    "Controller",
    "DroneEnv",
    "DroneVectorEnv",
    "KestrelError",
    "Policy",
    "Run",
    "Study",
    "__version__",
    "airframe_path",
    "evaluate",
    "export",
    "import_policy",
    "make",
    "make_vec",
    "parallel_env",
    "resume",
    "task_ids",
    "task_path",
    "task_paths",
    "train",
]
