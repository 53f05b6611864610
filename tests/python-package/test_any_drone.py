"""Two pilots for any quadrotor on the same drones: ours (``assets/pilots/any.kestrel``) and RAPTOR (Eschmann et al. 2025) of the
package ``foundation-policy``.

Every drone is drawn anew as ``configs/any.yaml`` draws it, and starts as that is judged: half a metre away, tilted by up to 90
degrees, moving and turning. A flight counts if it stays within 10 cm of the goal from 5 to 8 s.

``python tests/python-package/test_any_drone.py [DRONES]`` prints the table of docs/the-drone.md.
"""

import sys

import kestrel_drones
import numpy as np
from test_raptor import STARTS, headings, observed, raptor

CONTROL_RATE_HZ, SECS, SETTLED_FROM_SECS, SETTLED_M = 100, 8, 5, 0.1

SAME = {"latency": {"state_secs": [0, 0], "motor_secs": [0, 0]}, "randomisation": {"battery_share": [1, 1]}}
CONDITIONS = {"exact": SAME, "as trained": {}}
CLASSES = {
    "all": {},
    "arm 3 to 6 cm": {"arm_m": [0.03, 0.06]},
    "arm 6 to 15 cm": {"arm_m": [0.06, 0.15]},
    "arm 15 to 40 cm": {"arm_m": [0.15, 0.4]},
    "thrust 1.5 to 2 times the weight": {"thrust_to_weight": [1.5, 2.0]},
    "thrust 3 to 5 times the weight": {"thrust_to_weight": [3.0, 5.0]},
    "rotors of 10 to 30 ms": {"rotor_lag_secs": [0.01, 0.03]},
    "rotors of 30 to 100 ms, as RAPTOR was trained with": {"rotor_lag_secs": [0.03, 0.1]},
    "rotors of 80 to 150 ms": {"rotor_lag_secs": [0.08, 0.15]},
}

# Sides of the rotors, clockwise from the front right one: about x, y, z.
MIXER = np.array([[-1, -1, -1], [-1, 1, 1], [1, 1, -1], [1, -1, 1]]) / 2

# No action stops a rotor quite.
LOWEST_SHARE = 2e-6


def environments(drones, condition, count):
    """As many drones, which end only when they are lost or the time is over."""
    changes = CONDITIONS[condition]
    randomisation = {"airframes": drones, **changes.get("randomisation", {})}
    scenario = {"randomisation": randomisation, **({"latency": changes["latency"]} if "latency" in changes else {})}
    return kestrel_drones.make_vec(
        "any",
        num_envs=count,
        seed=0,
        **{
            "scenario.start": STARTS["hard"],
            "scenario.episode_secs": SECS + 1,
            "scenario.action": {"thrust_torques": {"lowest_share": LOWEST_SHARE}},
            "scenario": scenario,
        },
    )


class Raptor:
    """Motor speeds from what it reads, as thrust and torques."""

    def __init__(self, envs, count):
        self.envs, self.policy = envs, raptor()
        self.policy.reset()
        self.world_from_heading = headings(envs.states())
        self.last = np.zeros((count, 4))

    def __call__(self, _observations):
        self.last = self.policy.evaluate_step(observed(self.envs.states("known"), self.world_from_heading, self.last))
        shares = (0.5 + 0.5 * self.last) ** 2
        return np.column_stack([2 * shares.mean(axis=1) - 1, shares @ MIXER]).astype(np.float32)


class Ours:
    """The pilot that comes with the package."""

    def __init__(self, _envs, count):
        self.policy = kestrel_drones.Policy.load("any")
        self.memory = self.policy.memory(count)

    def __call__(self, observations):
        return self.policy.act(observations, memory=self.memory)


def success(pilot, drones, condition, count):
    """Share of the drones that settle."""
    envs = environments(drones, condition, count)
    observations, _ = envs.reset()
    act = pilot(envs, count)
    lost, away = np.zeros(count, dtype=bool), np.zeros(count, dtype=bool)
    for step in range(SECS * CONTROL_RATE_HZ):
        observations, _, terminations, truncations, _ = envs.step(act(observations))
        lost |= terminations | truncations
        if step >= SETTLED_FROM_SECS * CONTROL_RATE_HZ:
            state = envs.states()
            away |= np.linalg.norm(state["position_m"] - state["goal_m"], axis=1) > SETTLED_M
    return 1 - (lost | away).mean()


def test_ours_flies_drones_that_nobody_has_seen():
    assert success(Ours, {}, "as trained", 128) >= 0.96


def test_raptor_flies_most_of_them_with_an_exact_state():
    assert success(Raptor, {"rotor_lag_secs": [0.01, 0.1]}, "exact", 64) >= 0.7


def main():
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    pilots = {"any": Ours, "RAPTOR": Raptor}
    columns = [(name, condition) for condition in CONDITIONS for name in pilots]
    print("| drones | " + " | ".join(f"{name}, {condition}" for name, condition in columns) + " |")
    print("|---|" + "--:|" * len(columns))
    for name, drones in CLASSES.items():
        shares = [success(pilots[pilot], drones, condition, count) for pilot, condition in columns]
        print(f"| {name} | " + " | ".join(f"{100 * share:.1f} %" for share in shares) + " |", flush=True)


if __name__ == "__main__":
    main()
