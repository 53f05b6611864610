"""A team of drones in one environment."""

import numpy as np
from gymnasium.utils import seeding
from pettingzoo import ParallelEnv

from . import _tasks
from ._native import Environments, KestrelError


class DroneParallelEnv(ParallelEnv):
    """A team's task as PettingZoo's parallel environment; the agents are ``drone_0``, ``drone_1``, …

    ``config``, ``starts`` and further keywords are those of ``DroneVectorEnv``. Where the task says
    that an episode ends for one alone (``ends: alone``), that drone leaves ``agents``; its body begins anew and hovers.
    """

    metadata = {"name": "kestrel", "render_modes": ["rgb_array"], "is_parallelizable": True}

    def __init__(self, config, *, starts="training", render_mode=None, **set):
        _tasks.refuse_other_mode(render_mode)
        self.render_mode = render_mode
        self.task = _tasks.load(config, set)
        self.metadata = {**self.metadata, "name": self.task.name, "render_fps": self.task.control_rate_hz}
        self.possible_agents = [f"drone_{index}" for index in range(self.task.agents)]
        self._rows = {agent: row for row, agent in enumerate(self.possible_agents)}
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
        columns = {"observations": self.native.observations(), "images": self.native.images()}
        return {agent: self._observation(columns, self._rows[agent]) for agent in self.agents}, {a: {} for a in self.agents}

    def step(self, actions):
        """One control period; every agent acts."""
        missing = [agent for agent in self.agents if agent not in actions]
        if missing or not self.agents:
            found = f"none for {', '.join(missing)}" if missing else "a step after the end of the episode"
            raise KestrelError(f"actions: found {found}, expected one for each of env.agents after reset()")
        table = np.zeros((len(self.possible_agents), self.task.action_len), dtype=np.float32)
        for agent in self.agents:
            table[self._rows[agent]] = actions[agent]
        step, agents = self.native.step(table), self.agents
        ended = step["ended"] or {"rows": []}
        place = {row: index for index, row in enumerate(ended["rows"])}
        self._begun = len(place) == len(self.possible_agents)
        self.agents = [agent for agent in agents if self._rows[agent] not in place]
        terms = self.native.reward_terms()
        observations, infos = {}, {}
        for agent in agents:
            row = self._rows[agent]
            infos[agent] = {"reward_terms": self._terms(terms[row])}
            index = place.get(row)
            observations[agent] = self._observation(step if index is None else ended, row if index is None else index)
            if index is not None:
                infos[agent]["is_success"] = bool(ended["successes"][index])
                infos[agent]["ending"] = ended["endings"][index]
                infos[agent]["episode_reward_terms"] = self._terms(ended["terms"][index])
        columns = [step[key].tolist() for key in ("rewards", "terminations", "truncations")]
        rewards, terminations, truncations = ({agent: column[self._rows[agent]] for agent in agents} for column in columns)
        return observations, rewards, terminations, truncations, infos

    def states(self, which="true"):
        """Where the drones are now: for each possible agent a row of ``DroneVectorEnv.states``, by the same names."""
        columns = self.native.states(which)
        return {agent: {name: rows[row] for name, rows in columns.items()} for agent, row in self._rows.items()}

    def render(self):
        """A picture ``[240, 320, 3]`` from behind the team, where ``render_mode`` asks for it."""
        return None if self.render_mode is None else self.native.render(0, _tasks.RENDER_SIZE)

    def _terms(self, row):
        return dict(zip(self.task.reward_terms, row.tolist(), strict=True))

    @staticmethod
    def _observation(columns, row):
        observation, images = columns["observations"][row], columns["images"]
        return observation if images is None else {"observation": observation, "image": images[row]}
