"""PPO of Stable-Baselines3 learns hover, and is judged as Kestrel's policies are.

    pip install kestrel-drones stable-baselines3
    python sb3_ppo.py [--seeds 0 1 2] [--kestrel]

Settings are those of configs/hover.yaml as far as Stable-Baselines3 has them; its critic reads what the policy reads.
``--kestrel`` trains the same task with Kestrel's PPO beside it.
"""

import argparse
import tempfile
import time
from pathlib import Path

import kestrel_drones
import numpy as np
import torch
from kestrel_drones.sb3 import Sb3VecEnv
from stable_baselines3 import PPO


def learned(config, seed, steps, net_arch=(64, 64)):
    """A policy after so many steps, and the seconds that it took."""
    envs = Sb3VecEnv(config, num_envs=1024, seed=seed, threads=torch.get_num_threads())
    model = PPO(
        "MlpPolicy",
        envs,
        n_steps=32,
        batch_size=1024,
        n_epochs=4,
        gamma=0.99,
        max_grad_norm=1.0,
        learning_rate=lambda left: 3e-5 + left * (2e-3 - 3e-5),
        policy_kwargs={"net_arch": list(net_arch), "log_std_init": -0.7},
        seed=seed,
        device="cpu",
    )
    begun = time.perf_counter()
    model.learn(steps)
    return model, time.perf_counter() - begun


def success_rate(config, act, starts=1024, seed=0):
    """Share of successes in the first episodes from the starts of the task's evaluation, flown by ``act(observations)``."""
    envs = kestrel_drones.make_vec(config, num_envs=starts, starts="evaluation", seed=seed)
    observations, _ = envs.reset()
    flying, success = np.ones(starts, bool), np.zeros(starts, bool)
    while flying.any():
        observations, _, terminations, truncations, infos = envs.step(act(observations))
        first = flying & (terminations | truncations)
        if first.any():
            success[first] = infos["final_info"]["is_success"][first]
        flying &= ~first
    return success.mean()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--task", default="hover")
    parser.add_argument("--steps", type=int, default=4_915_200)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--kestrel", action="store_true")
    asked = parser.parse_args()
    torch.set_num_threads(asked.threads)
    print(f"{'trainer':<10} {'seed':>4} {'steps':>10} {'seconds':>8} {'success':>8}")
    for seed in asked.seeds:
        model, secs = learned(asked.task, seed, asked.steps)
        rate = success_rate(asked.task, lambda observations: model.predict(observations, deterministic=True)[0])
        print(f"{'SB3':<10} {seed:>4} {model.num_timesteps:>10} {secs:>8.1f} {100 * rate:>6.1f} %", flush=True)
        if asked.kestrel:
            with tempfile.TemporaryDirectory() as folder:
                training = {"analytic": None, "total_steps": asked.steps}
                begun = time.perf_counter()
                run = kestrel_drones.train(
                    asked.task, seed=seed, out=Path(folder) / "run", threads=asked.threads, training=training
                )
                whole = time.perf_counter() - begun
                secs, rate = run.rows[-1]["training_secs"], run.evaluation["rows"][0]["success_rate"]
            said = f"{'Kestrel':<10} {seed:>4} {asked.steps:>10} {secs:>8.1f} {100 * rate:>6.1f} %"
            print(f"{said} ({whole:.1f} s with exports, evaluation and pictures)", flush=True)


if __name__ == "__main__":
    main()
