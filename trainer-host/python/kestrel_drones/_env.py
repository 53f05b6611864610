"""One environment of one drone."""

import gymnasium
import numpy as np

from . import _tasks
from ._native import Environments


class DroneEnv(gymnasium.Env):
    """A task as a plain gymnasium environment; many of them are faster as a ``DroneVectorEnv``.

    ``config``, ``starts`` and further keywords are those of ``DroneVectorEnv``. Of the same seed, the first episode is
    that of environment 0 there.
    """

    metadata = {"render_modes": ["rgb_array"]}

    def __init__(self, config, *, starts="training", render_mode=None, **set):
        _tasks.refuse_other_mode(render_mode)
        self.render_mode = render_mode
        self.task = _tasks.load(config, set)
        _tasks.refuse_team(self.task)
        self.observation_space = _tasks.observation_space(self.task)
        self.action_space = _tasks.action_space(self.task)
        self.native = Environments(self.task, 1, starts, 1)
        self.metadata = {**self.metadata, "render_fps": self.task.control_rate_hz}
        # Whether the simulator has begun another episode that nobody has seen.
        self._begun = False

    def reset(self, *, seed=None, options=None):
        """Begins a new episode, from ``seed`` or what follows from the last."""
        super().reset(seed=seed)
        if seed is not None or not self._begun:
            self.native.reset(int(self.np_random.integers(2**63)) if seed is None else seed)
        self._begun = False
        return self._observation(self.native.observations(), self.native.images()), {}

    def step(self, action):
        """One control period."""
        step = self.native.step(np.asarray(action, dtype=np.float32)[None])
        ended = step["ended"]
        info = {"reward_terms": self._terms(self.native.reward_terms())}
        if ended is None:
            observation = self._observation(step["observations"], step["images"])
        else:
            self._begun = True
            observation = self._observation(ended["observations"], ended["images"])
            info["is_success"] = bool(ended["successes"][0])
            info["ending"] = ended["endings"][0]
            info["episode_reward_terms"] = self._terms(ended["terms"])
        terminated, truncated = bool(step["terminations"][0]), bool(step["truncations"][0])
        return observation, float(step["rewards"][0]), terminated, truncated, info

    def state(self, which="true"):
        """Where the drone is now: a row of ``DroneVectorEnv.states``, by the same names."""
        return {name: rows[0] for name, rows in self.native.states(which).items()}

    def render(self):
        """A picture ``[240, 320, 3]`` from behind the drone, where ``render_mode`` asks for it."""
        return None if self.render_mode is None else self.native.render(0, _tasks.RENDER_SIZE)

    def _terms(self, rows):
        return dict(zip(self.task.reward_terms, rows[0].tolist(), strict=True))

    @staticmethod
    def _observation(observations, images):
        return observations[0] if images is None else {"observation": observations[0], "image": images[0]}
