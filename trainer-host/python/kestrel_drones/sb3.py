"""Environments for Stable-Baselines3, which has a vector interface of its own, and its policies; needs
``stable-baselines3``."""

import time

import numpy as np
from stable_baselines3.common.vec_env import VecEnv

from ._policy import import_policy
from ._vector_env import DroneVectorEnv


class Sb3VecEnv(VecEnv):
    """A ``DroneVectorEnv`` with the methods of Stable-Baselines3; its keywords are the same."""

    def __init__(self, config, num_envs=1, **keywords):
        self.envs = DroneVectorEnv(config, num_envs, **keywords)
        super().__init__(num_envs, self.envs.single_observation_space, self.envs.single_action_space)
        self._begun = time.time()

    def reset(self):
        """Begins new episodes everywhere."""
        seed, self._seeds = self._seeds[0], [None] * self.num_envs
        observations, _ = self.envs.reset(seed=seed)
        self._returns, self._lengths = np.zeros(self.num_envs), np.zeros(self.num_envs, dtype=int)
        return observations

    def step_async(self, actions):
        """Keeps the actions for ``step_wait``."""
        self._actions = actions

    def step_wait(self):
        """One control period; what ended is in the dictionaries, by the names of Stable-Baselines3."""
        observations, rewards, terminations, truncations, found = self.envs.step(self._actions)
        infos = [{} for _ in range(self.num_envs)]
        self._returns += rewards
        self._lengths += 1
        ended = terminations | truncations
        for row in np.flatnonzero(ended):
            episode = {"r": self._returns[row], "l": self._lengths[row], "t": time.time() - self._begun}
            infos[row] = {
                "terminal_observation": found["final_obs"][row],
                "TimeLimit.truncated": bool(truncations[row]),
                "is_success": bool(found["final_info"]["is_success"][row]),
                "ending": found["final_info"]["ending"][row],
                "episode": episode,
            }
        self._returns[ended], self._lengths[ended] = 0.0, 0
        return observations, rewards, ended, infos

    def close(self):
        """Nothing is open."""
        self.envs.close()

    def get_attr(self, attr_name, indices=None):
        """The same for every environment."""
        return [getattr(self.envs, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name, value, indices=None):
        """Not for one environment of many."""
        raise NotImplementedError("the environments of a DroneVectorEnv have no attributes of their own")

    def env_method(self, method_name, *method_args, indices=None, **method_kwargs):
        """Not for one environment of many."""
        raise NotImplementedError("the environments of a DroneVectorEnv have no methods of their own")

    def env_is_wrapped(self, wrapper_class, indices=None):
        """They never are."""
        return [False for _ in self._get_indices(indices)]


def import_model(model, task, **keywords):
    """``kestrel_drones.import_policy`` of a trained model: PPO and A2C, or SAC and TD3 with ``activation_fn=torch.nn.Tanh``.

    What a ``VecNormalize`` around its environments does to observations becomes part of the policy, but for its limits.
    """
    tensors, normalise = dict(model.policy.state_dict()), model.get_vec_normalize_env()
    if normalise is not None and normalise.norm_obs:
        moments = {"obs_rms.mean": normalise.obs_rms.mean, "obs_rms.var": normalise.obs_rms.var}
        tensors |= {name: values.astype(np.float32) for name, values in moments.items()}
    return import_policy(tensors, task, activation=model.policy.activation_fn.__name__.lower(), **keywords)
