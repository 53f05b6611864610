"""A team of drones in one environment."""

import numpy as np
from gymnasium.utils import seeding
from pettingzoo import ParallelEnv

from . import _tasks
from ._native import Environments, KestrelError


class DroneParallelEnv(ParallelEnv):
    """A team's task as PettingZoo's parallel environment; the agents are ``drone_0``, ``drone_1``, …

    ``config``, ``starts`` and further keywords are those of ``DroneVectorEnv``. The episode of a team ends for all at once.
    """

    metadata = {"name": "kestrel", "render_modes": [], "is_parallelizable": True}
    render_mode = None

    def __init__(self, config, *, starts="training", **set):
        self.task = _tasks.load(config, set)
        self.metadata = {**self.metadata, "name": self.task.name, "render_fps": self.task.control_rate_hz}
        self.possible_agents = [f"drone_{index}" for index in range(self.task.agents)]
        self.agents = []
        self.observation_spaces = {agent: _tasks.observation_space(self.task) for agent in self.possible_agents}
        self.action_spaces = {agent: _tasks.action_space(self.task) for agent in self.possible_agents}
        self.native = Environments(self.task, 1, starts, 1)
        self._np_random = None
        # Whether the simulator has begun another episode that nobody has seen.
        self._begun = False

    def observation_space(self, agent):
        """What an agent observes."""
        return self.observation_spaces[agent]

    def action_space(self, agent):
        """What an agent can do."""
        return self.action_spaces[agent]

    def reset(self, seed=None, options=None):
        """Begins a new episode, from ``seed`` or what follows from the last."""
        if seed is not None or self._np_random is None:
            self._np_random, _ = seeding.np_random(seed)
        if seed is not None or not self._begun:
            self.native.reset(int(self._np_random.integers(2**63)) if seed is None else seed)
        self._begun = False
        self.agents = list(self.possible_agents)
        observations = self._observations(self.native.observations(), self.native.images())
        return observations, {agent: {} for agent in self.agents}

    def step(self, actions):
        """One control period; every agent acts."""
        missing = [agent for agent in self.agents if agent not in actions]
        if missing or not self.agents:
            found = f"none for {', '.join(missing)}" if missing else "a step after the end of the episode"
            raise KestrelError(f"actions: found {found}, expected one for each of env.agents after reset()")
        step = self.native.step(np.stack([actions[agent] for agent in self.agents]).astype(np.float32, copy=False))
        agents, ended, terms = self.agents, step["ended"], self.native.reward_terms()
        infos = {agent: {"reward_terms": self._terms(row)} for agent, row in zip(agents, terms, strict=True)}
        last = step if ended is None else ended
        if ended is not None:
            self._begun = True
            self.agents = []
            for index, agent in enumerate(agents):
                infos[agent]["is_success"] = bool(ended["successes"][index])
                infos[agent]["ending"] = ended["endings"][index]
                infos[agent]["episode_reward_terms"] = self._terms(ended["terms"][index])
        columns = [step[key].tolist() for key in ("rewards", "terminations", "truncations")]
        rewards, terminations, truncations = (dict(zip(agents, column, strict=True)) for column in columns)
        return self._observations(last["observations"], last["images"]), rewards, terminations, truncations, infos

    def _terms(self, row):
        return dict(zip(self.task.reward_terms, row.tolist(), strict=True))

    def _observations(self, observations, images):
        if images is None:
            return dict(zip(self.possible_agents, observations, strict=True))
        pairs = zip(self.possible_agents, observations, images, strict=True)
        return {agent: {"observation": observation, "image": image} for agent, observation, image in pairs}
