"""SAC of Stable-Baselines3 learns hover, and its policy is imported.

    pip install kestrel-drones stable-baselines3
    python sb3_sac.py [--seeds 0 1 2] [--steps 300000]

Tangents between the layers, as behind the last one: a policy file has one activation. Prints the success in 1,024 evaluation
starts as it learns.
"""

import argparse
import time

import numpy as np
import torch
from kestrel_drones.sb3 import Sb3VecEnv, import_model
from stable_baselines3 import SAC
from stable_baselines3.common.callbacks import BaseCallback

from sb3_ppo import success_rate


class Judge(BaseCallback):
    """Prints a row of the table every so many steps; the time that it takes is not counted."""

    def __init__(self, config, seed, every):
        super().__init__()
        self.config, self.seed, self.every, self.next = config, seed, every, every
        self.begun = clocks()

    def _on_step(self):
        if self.num_timesteps >= self.next:
            self.next += self.every
            self.tell()
        return True

    def tell(self):
        stopped = clocks()
        wall, processor = stopped - self.begun
        rate = success_rate(self.config, lambda observations: self.model.predict(observations, deterministic=True)[0])
        print(f"{self.seed:>4} {self.num_timesteps:>10} {wall:>8.0f} {processor:>10.0f} {100 * rate:>6.1f} %", flush=True)
        self.begun += clocks() - stopped


def clocks():
    """Seconds on the wall, and of this process on processors."""
    return np.array([time.perf_counter(), time.process_time()])


def learned(config, seed, steps):
    """A policy after so many steps: 64 environments, and a gradient step for every four of theirs."""
    model = SAC(
        "MlpPolicy",
        Sb3VecEnv(config, num_envs=64, seed=seed, threads=1),
        buffer_size=500_000,
        learning_starts=10_000,
        batch_size=1024,
        train_freq=1,
        gradient_steps=16,
        gamma=0.98,
        tau=0.02,
        # At a constant rate it unlearns again after 200,000 steps.
        learning_rate=lambda left: 1e-4 + 2e-3 * left,
        # Rewards are a twentieth a step.
        ent_coef="auto_0.1",
        policy_kwargs={"net_arch": [64, 64], "activation_fn": torch.nn.Tanh},
        seed=seed,
        device="cpu",
    )
    return model.learn(steps, callback=Judge(config, seed, 50_000))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--task", default="hover")
    parser.add_argument("--steps", type=int, default=300_000)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    asked = parser.parse_args()
    torch.set_num_threads(1)
    print(f"{'seed':>4} {'steps':>10} {'seconds':>8} {'processor':>10} {'success':>8}")
    for seed in asked.seeds:
        policy = import_model(learned(asked.task, seed, asked.steps), asked.task)
        print(f"imported, in fixed point: {100 * success_rate(asked.task, policy.act):.1f} %")


if __name__ == "__main__":
    main()
