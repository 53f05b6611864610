"""Trains a small policy with PPO of Stable-Baselines3 and keeps it in the forms that its users have.

    pip install kestrel-drones stable-baselines3 safetensors onnx onnxscript
    python make.py [--steps 3276800]

Settings are those of trainer-host/python/examples/sb3_ppo.py with two layers of 32. Writes sb3-ppo.safetensors, the whole
state dict; sb3-ppo.onnx, the actor by torch.onnx.export; sb3-ppo.json, what `predict` does on observations from flights.
"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import save_file

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "../../../trainer-host/python/examples"))

import sb3_ppo
from kestrel_drones.sb3 import Sb3VecEnv


class Actor(torch.nn.Module):
    """What Stable-Baselines3's page on exporting policies to ONNX recommends, for the action alone."""

    def __init__(self, policy):
        super().__init__()
        self.policy = policy

    def forward(self, observation):
        return self.policy(observation, deterministic=True)[0]


def met(model, flights=16, every=8):
    """Observations `[flights][observation]`, one of each flight, each later than the one before."""
    envs = Sb3VecEnv("hover", num_envs=flights, seed=1)
    observations, kept = envs.reset(), []
    for step in range(flights * every):
        if step % every == 0:
            kept.append(observations[step // every])
        observations, _, _, _ = envs.step(model.predict(observations, deterministic=True)[0])
    return np.array(kept)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=3_276_800)
    asked = parser.parse_args()
    torch.set_num_threads(1)
    model, secs = sb3_ppo.learned("hover", 0, asked.steps, net_arch=[32, 32])
    rate = sb3_ppo.success_rate("hover", lambda observations: model.predict(observations, deterministic=True)[0])
    print(f"{model.num_timesteps} steps, {secs:.0f} s, {100 * rate:.1f} % of 1,024 evaluation starts")
    save_file(model.policy.state_dict(), HERE / "sb3-ppo.safetensors")
    observations = met(model)
    example = torch.from_numpy(observations[:1])
    names = {"input_names": ["observation"], "output_names": ["action"]}
    torch.onnx.export(Actor(model.policy), (example,), HERE / "sb3-ppo.onnx", dynamo=False, **names)
    actions = model.predict(observations, deterministic=True)[0]
    rows = {"observations": observations.tolist(), "actions": actions.tolist()}
    (HERE / "sb3-ppo.json").write_text(json.dumps(rows) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
