"""SAC of Stable-Baselines3 learns hover, and its policy is imported.

    pip install kestrel-drones stable-baselines3
    python sb3_sac.py [--seeds 0 1 2] [--steps 900000]

The actor has tangents between the layers, as behind the last one, because a policy file has one activation; the critics have
rectifiers, and their layers are normalised: without that, the success swings and stays below 90 %. Prints the success in 256
test starts as it learns, and that of the best policy in the 1,024 of the evaluation.
"""

import argparse
import copy
import time

import numpy as np
import torch
from kestrel_drones.sb3 import Sb3VecEnv, import_model
from stable_baselines3 import SAC
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.sac.policies import SACPolicy

from sb3_ppo import success_rate

TASK = "hover"

REWARDS = [
    {"distance": {"weight": -2.0}},
    {"proximity": {"weight": 1.0, "scale_m": 0.1}},
    {"proximity": {"weight": 2.0, "scale_m": 0.03}},
    {"velocity": {"weight": -0.05}},
    {"body_rates": {"weight": -0.03}},
    {"action_change": {"weight": -0.2}},
    {"heading_error": {"weight": -0.2}},
    {"alive": {"weight": 2.0}},
    {"failure": {"weight": -2.0}},
]
"""Those of hover, and a sharper proximity."""


class Policy(SACPolicy):
    """An actor that a policy file can hold, with other critics."""

    def make_critic(self, features_extractor=None):
        self.critic_kwargs["activation_fn"] = torch.nn.ReLU
        critic = super().make_critic(features_extractor)
        for network in critic.q_networks:
            for place in reversed(range(len(network) - 1)):
                if isinstance(network[place], torch.nn.Linear):
                    network.insert(place + 1, torch.nn.LayerNorm(network[place].out_features))
        return critic


class Keeper(BaseCallback):
    """Averages the actor's weights over some hundred steps, because the newest ones swing, tests the average now and then in
    starts of its own, as Kestrel's trainer does, and keeps the best one.

    The time that tests take is not counted.
    """

    def __init__(self, seed, every):
        super().__init__()
        self.seed, self.every, self.next = seed, every, every
        self.best, self.best_rate = None, -1.0
        self.begun = clocks()

    def _on_training_start(self):
        self.average = copy.deepcopy(self.model.actor)

    @torch.no_grad()
    def _on_step(self):
        for mean, newest in zip(self.average.parameters(), self.model.actor.parameters(), strict=True):
            mean.lerp_(newest, 0.01)
        if self.num_timesteps >= self.next:
            self.next += self.every
            self.test()
        return True

    def test(self):
        stopped = clocks()
        wall, processor = stopped - self.begun
        rate = success_rate(TASK, self.act, starts=256, seed=1)
        if rate > self.best_rate:
            self.best, self.best_rate = copy.deepcopy(self.average.state_dict()), rate
        print(f"{self.seed:>4} {self.num_timesteps:>10} {wall:>8.0f} {processor:>10.0f} {100 * rate:>6.1f} %", flush=True)
        self.begun += clocks() - stopped

    def act(self, observations):
        return self.average(torch.as_tensor(observations), deterministic=True).numpy()

    def _on_training_end(self):
        self.model.actor.load_state_dict(self.best)


def clocks():
    """Seconds on the wall, and of this process on processors."""
    return np.array([time.perf_counter(), time.process_time()])


def learned(seed, steps):
    """A policy after so many steps: 64 environments, and a gradient step for every four of theirs."""
    model = SAC(
        Policy,
        Sb3VecEnv(TASK, num_envs=64, seed=seed, threads=1, **{"scenario.rewards": REWARDS}),
        buffer_size=1_000_000,
        learning_starts=20_000,
        batch_size=256,
        train_freq=1,
        gradient_steps=16,
        gamma=0.985,
        # What an action does is seen some periods later: states and motors are late.
        n_steps=3,
        learning_rate=lambda left: 2e-5 + 1e-3 * left,
        # Rewards are a twentieth a step.
        ent_coef="auto_0.1",
        policy_kwargs={"net_arch": {"pi": [64, 64], "qf": [128, 128]}, "activation_fn": torch.nn.Tanh},
        seed=seed,
        device="cpu",
    )
    return model.learn(steps, callback=Keeper(seed, 20_000))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=900_000)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    asked = parser.parse_args()
    torch.set_num_threads(1)
    print(f"{'seed':>4} {'steps':>10} {'seconds':>8} {'processor':>10} {'success':>8}")
    for seed in asked.seeds:
        policy = import_model(learned(seed, asked.steps), TASK)
        print(f"{seed:>4} the best, imported, in fixed point: {100 * success_rate(TASK, policy.act):.1f} %", flush=True)


if __name__ == "__main__":
    main()
