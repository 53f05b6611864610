"""PPO in one file, in the style and with the names of CleanRL's ppo_continuous_action.py, learns hover.

    pip install kestrel-drones torch
    python cleanrl_ppo.py [--seeds 0 1 2] [--steps 4915200]

CleanRL is no package, so this is its algorithm for many environments: shuffled minibatches, clipped objectives, generalised
advantages, an annealed learning rate. A truncated episode bootstraps from its last observation. The policy is imported from
its state dict.
"""

import argparse
import time

import kestrel_drones
import numpy as np
import torch
from torch import nn
from torch.distributions.normal import Normal

from sb3_ppo import success_rate

ENVS, STEPS, MINIBATCH, EPOCHS = 1024, 32, 1024, 4
GAMMA, GAE_LAMBDA, CLIP, VF_COEF, MAX_GRAD_NORM = 0.99, 0.95, 0.2, 0.5, 1.0
LEARNING_RATE = 2e-3


def layer_init(layer, std=np.sqrt(2)):
    nn.init.orthogonal_(layer.weight, std)
    nn.init.constant_(layer.bias, 0.0)
    return layer


class Agent(nn.Module):
    def __init__(self, observation_len, action_len):
        super().__init__()

        def network(outputs, std):
            first, second = nn.Linear(observation_len, 64), nn.Linear(64, 64)
            last = layer_init(nn.Linear(64, outputs), std)
            return nn.Sequential(layer_init(first), nn.Tanh(), layer_init(second), nn.Tanh(), last)

        self.critic = network(1, 1.0)
        self.actor_mean = network(action_len, 0.01)
        self.actor_logstd = nn.Parameter(torch.full((1, action_len), -0.7))

    def distribution(self, observations):
        return Normal(self.actor_mean(observations), self.actor_logstd.exp())


def rollout(agent, envs, observations):
    """Columns `[STEPS][ENVS]` of what was seen, done and paid, and the observation behind them."""
    seen, actions, rewards, values, nexts, ends = ([] for _ in range(6))
    for _ in range(STEPS):
        with torch.no_grad():
            action = agent.distribution(observations).sample()
            values.append(agent.critic(observations).flatten())
        seen.append(observations)
        actions.append(action)
        following, reward, terminated, truncated, infos = envs.step(action.clamp(-1, 1).numpy())
        final = following.copy()
        ended = terminated | truncated
        if ended.any():
            final[ended] = np.stack(infos["final_obs"][ended])
        with torch.no_grad():
            worth = agent.critic(torch.from_numpy(final)).flatten()
        nexts.append(worth * torch.from_numpy(~terminated))
        ends.append(torch.from_numpy(ended))
        rewards.append(torch.from_numpy(reward))
        observations = torch.from_numpy(following)
    return [torch.stack(column) for column in (seen, actions, rewards, values, nexts, ends)], observations


def advantages(rewards, values, nexts, ends):
    found, last = torch.zeros_like(rewards), torch.zeros(ENVS)
    for step in reversed(range(STEPS)):
        delta = rewards[step] + GAMMA * nexts[step] - values[step]
        last = delta + GAMMA * GAE_LAMBDA * (~ends[step]) * last
        found[step] = last
    return found


def update(agent, optimizer, columns):
    seen, actions, rewards, values, nexts, ends = columns
    advantage = advantages(rewards, values, nexts, ends)
    returns = (advantage + values).flatten()
    seen, actions, advantage = seen.flatten(0, 1), actions.flatten(0, 1), advantage.flatten()
    with torch.no_grad():
        before = agent.distribution(seen).log_prob(actions).sum(1)
    for _ in range(EPOCHS):
        for rows in torch.randperm(len(seen)).split(MINIBATCH):
            ratio = (agent.distribution(seen[rows]).log_prob(actions[rows]).sum(1) - before[rows]).exp()
            normal = (advantage[rows] - advantage[rows].mean()) / (advantage[rows].std() + 1e-8)
            policy_loss = -torch.min(normal * ratio, normal * ratio.clamp(1 - CLIP, 1 + CLIP)).mean()
            value_loss = 0.5 * (agent.critic(seen[rows]).flatten() - returns[rows]).square().mean()
            optimizer.zero_grad()
            (policy_loss + VF_COEF * value_loss).backward()
            nn.utils.clip_grad_norm_(agent.parameters(), MAX_GRAD_NORM)
            optimizer.step()


def learned(config, seed, steps):
    """A policy after so many steps."""
    torch.manual_seed(seed)
    envs = kestrel_drones.make_vec(config, num_envs=ENVS, seed=seed, threads=1)
    agent = Agent(envs.single_observation_space.shape[0], envs.single_action_space.shape[0])
    optimizer = torch.optim.Adam(agent.parameters(), lr=LEARNING_RATE, eps=1e-5)
    observations = torch.from_numpy(envs.reset()[0])
    updates = steps // (ENVS * STEPS)
    for done in range(updates):
        optimizer.param_groups[0]["lr"] = LEARNING_RATE * (1.0 - done / updates)
        columns, observations = rollout(agent, envs, observations)
        update(agent, optimizer, columns)
    return agent


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--task", default="hover")
    parser.add_argument("--steps", type=int, default=4_915_200)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    asked = parser.parse_args()
    torch.set_num_threads(1)
    print(f"{'seed':>4} {'steps':>10} {'seconds':>8} {'processor':>10} {'success':>8}")
    for seed in asked.seeds:
        wall, processor = time.perf_counter(), time.process_time()
        agent = learned(asked.task, seed, asked.steps)
        wall, processor = time.perf_counter() - wall, time.process_time() - processor
        policy = kestrel_drones.import_policy(agent.state_dict(), asked.task)
        rate = success_rate(asked.task, policy.act)
        print(f"{seed:>4} {asked.steps:>10} {wall:>8.0f} {processor:>10.0f} {100 * rate:>6.1f} %", flush=True)


if __name__ == "__main__":
    main()
