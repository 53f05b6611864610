"""Many environments of one task that step together in Rust."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from . import _tasks
from ._native import Environments


class DroneVectorEnv(VectorEnv):
    """``num_envs`` environments of a task, as gymnasium's vector environments are.

    ``config`` is the name of a shipped task, the path of a YAML file or a dictionary; further keywords are laid over it:
    ``DroneVectorEnv("hover", scenario={"start": {"tilt_limit_deg": 45}})``. Environment ``i`` draws what is random from
    ``seed`` and ``i``; the bits do not depend on ``threads``, which are all cores by default. ``starts`` is ``"training"``
    or ``"evaluation"``, which has the task's own starts and time limit.

    An episode that ends begins anew in the same step: ``infos["final_obs"]`` and ``infos["final_info"]`` hold what it ended
    with (``is_success``, ``ending``, and ``episode_reward_terms``, the return of each term by name). Every array is new and
    belongs to the caller; the simulator's columns ``[values][rows]`` are transposed into it once.
    """

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP, "render_modes": ["rgb_array"]}

    def __init__(self, config, num_envs=1, *, seed=0, threads=None, starts="training", render_mode=None, **set):
        _tasks.refuse_other_mode(render_mode)
        self.render_mode = render_mode
        task = _tasks.load(config, set)
        _tasks.refuse_team(task)
        self.task = task
        self.num_envs = num_envs
        self.single_observation_space = _tasks.observation_space(task)
        self.single_action_space = _tasks.action_space(task)
        self.native = Environments(task, num_envs, starts, threads)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.metadata = {**self.metadata, "render_fps": task.control_rate_hz}
        self._first_seed = seed
        self._worker, self._sent = None, None

    def reset(self, *, seed=None, options=None):
        """Begins new episodes everywhere, from ``seed``, or the constructor's, or one that follows from the last."""
        if seed is None:
            seed, self._first_seed = self._first_seed, None
        super().reset(seed=seed)
        self.native.reset(int(self.np_random.integers(2**63)) if seed is None else seed)
        return self._batch(self.native.observations(), self.native.images()), {}

    def step(self, actions):
        """One control period of every environment with ``actions [num_envs, values]``."""
        step = self.native.step(np.asarray(actions, dtype=np.float32))
        ended = step["ended"]
        infos = {} if ended is None else self._infos(ended)
        observations = self._batch(step["observations"], step["images"])
        return observations, step["rewards"], step["terminations"], step["truncations"], infos

    def send(self, actions):
        """Begins a step with ``actions``, in another thread: the policy can learn meanwhile. ``recv`` returns what came of it.

        Until then nothing else is asked of the environments.
        """
        if self._sent is not None:
            raise RuntimeError("found a step that was sent and not received, expected recv() first")
        self._worker = self._worker or ThreadPoolExecutor(1, "kestrel")
        self._sent = self._worker.submit(self.step, np.array(actions, dtype=np.float32))

    def recv(self):
        """What ``step`` returns, of the step that was sent."""
        if self._sent is None:
            raise RuntimeError("found no step that was sent, expected send(actions) first")
        sent, self._sent = self._sent, None
        return sent.result()

    def close_extras(self, **_):
        """Ends the thread of ``send``."""
        if self._worker is not None:
            self._worker.shutdown()

    def render(self):
        """A picture ``[240, 320, 3]`` of every environment, from behind its drone, where ``render_mode`` asks for them."""
        if self.render_mode is None:
            return None
        return tuple(self.native.render(row, _tasks.RENDER_SIZE) for row in range(self.num_envs))

    def reward_terms(self):
        """Each term of the last step's rewards by name, ``[num_envs]``."""
        return dict(zip(self.task.reward_terms, self.native.reward_terms().T, strict=True))

    def privileged(self):
        """What only a critic may know now, such as wind and mass: ``[num_envs, values]``, of no values in some tasks."""
        return self.native.privileged()

    def states(self, which="true"):
        """Where the drones are now, by name, a row each; in steps that end an episode, of the next one.

        ``position_m``, ``velocity_m_per_s`` and ``goal_m`` ``[num_envs, 3]`` are in the world (x forward, y left, z up),
        ``body_rates_rad_per_s`` ``[num_envs, 3]`` in the body; ``rotation`` ``[num_envs, 3, 3]`` takes body into world, as
        does the unit quaternion ``attitude_wxyz`` ``[num_envs, 4]``; ``rotor_speeds_rad_per_s`` ``[num_envs, 4]`` are in the
        airframe's order. ``which`` is ``"true"``, or ``"known"`` for the state that the policy is told, late where the task
        has a latency.
        """
        return self.native.states(which)

    @staticmethod
    def _batch(observations, images):
        return observations if images is None else {"observation": observations, "image": images}

    def _infos(self, ended):
        """What gymnasium calls ``final_obs`` and ``final_info``, with a mask beside each."""
        rows, names = ended["rows"], self.task.reward_terms
        mask = np.zeros(self.num_envs, dtype=bool)
        mask[rows] = True
        final_obs, endings = np.empty(self.num_envs, dtype=object), np.empty(self.num_envs, dtype=object)  # of None
        endings[rows] = ended["endings"]
        if ended["images"] is None:
            last = ended["observations"]
        else:
            pairs = zip(ended["observations"], ended["images"], strict=True)
            last = [self._batch(observation, image) for observation, image in pairs]
        for row, observation in zip(rows.tolist(), last, strict=True):
            final_obs[row] = observation
        successes = np.zeros(self.num_envs, dtype=bool)
        successes[rows] = ended["successes"]
        terms = np.zeros((len(names), self.num_envs), dtype=np.float32)
        terms[:, rows] = ended["terms"].T
        infos = {
            "is_success": successes,
            "ending": endings,
            "episode_reward_terms": self._masked(dict(zip(names, terms, strict=True)), mask),
        }
        final_info = self._masked(infos, mask)
        return self._masked({"final_obs": final_obs, "final_info": final_info}, mask)

    @staticmethod
    def _masked(infos, mask):
        """The same with gymnasium's mask beside each."""
        return infos | {f"_{key}": mask for key in infos}
