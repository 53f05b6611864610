"""Steps per second of hover with random actions: from Python, in Rust, and of gym-pybullet-drones' physics.

    python trainer-host/python/benches/rate.py [--threads N] [--pybullet]

Rust steps the same environments with the same rules and actions (``Environments.rate``), so that the ratio is what Python
costs. ``--pybullet`` steps one drone of gym-pybullet-drones 2.x's HoverAviary beside it, if that is installed.
"""

import argparse
import time

import kestrel_drones
import numpy as np

STEPS = 64  # different actions, in turn


def of_python(envs, actions, secs):
    """Environment steps per second, with everything that a training loop receives."""
    envs.reset(seed=0)
    begun, steps = time.perf_counter(), 0
    while (elapsed := time.perf_counter() - begun) < secs:
        for action in actions:
            envs.step(action)
        steps += len(actions) * envs.num_envs
    return steps / elapsed


def of_pybullet(secs):
    """Environment steps per second of one HoverAviary, without a window."""
    from gym_pybullet_drones.envs.HoverAviary import HoverAviary
    from gym_pybullet_drones.utils.enums import ActionType

    env = HoverAviary(act=ActionType.RPM)
    env.reset(seed=0)
    env.action_space.seed(0)
    begun, steps = time.perf_counter(), 0
    while (elapsed := time.perf_counter() - begun) < secs:
        _, _, terminated, truncated, _ = env.step(env.action_space.sample())
        steps += 1
        if terminated or truncated:
            env.reset()
    return steps / elapsed


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--task", default="hover")
    parser.add_argument("--num-envs", type=int, default=1024)
    parser.add_argument("--threads", type=int, default=None)
    parser.add_argument("--secs", type=float, default=2.0)
    parser.add_argument("--repetitions", type=int, default=5)
    parser.add_argument("--pybullet", action="store_true")
    asked = parser.parse_args()

    envs = kestrel_drones.make_vec(asked.task, num_envs=asked.num_envs, threads=asked.threads)
    random = np.random.default_rng(0)
    actions = random.uniform(-1, 1, (STEPS, *envs.action_space.shape)).astype(np.float32)
    python, rust = [], []
    for _ in range(asked.repetitions):  # in turn, so that a busy machine is busy for both
        python.append(of_python(envs, actions, asked.secs))
        envs.reset(seed=0)
        rust.append(envs.native.rate(actions, asked.secs))
    best_python, best_rust = max(python), max(rust)
    ratios = sorted(a / b for a, b in zip(python, rust, strict=True))
    print(f"{asked.task}, {asked.num_envs} environments, random actions, threads: {asked.threads or 'all'}")
    print(f"through Python      {best_python:14,.0f} steps/s")
    print(f"in Rust             {best_rust:14,.0f} steps/s")
    print(f"ratio               {ratios[len(ratios) // 2]:14.2f} (median of {len(ratios)}, {ratios[0]:.2f} to {ratios[-1]:.2f})")
    if asked.pybullet:
        pybullet = of_pybullet(5 * asked.secs)
        print(f"gym-pybullet-drones {pybullet:14,.0f} steps/s, {best_python / pybullet:,.0f} times slower")


if __name__ == "__main__":
    main()
