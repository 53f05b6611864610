"""What users of gymnasium and PettingZoo rely on, through the installed wheel."""

import copy
import json
import os
import signal
import subprocess
import sys
import threading
import time
import warnings
from pathlib import Path

import gymnasium
import kestrel_drones
import numpy as np
import onnxruntime
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from kestrel_drones import KestrelError
from kestrel_drones._tasks import TEAMS, load, task_id
from pettingzoo.test import parallel_api_test

# A drone that ends often, so that few steps see all kinds of ends.
SHORT = {"scenario": {"episode_secs": 0.4, "success": {"settle": {"within_secs": 0.2}}}}

# Learns nothing, in seconds.
TINY = {"training": {"analytic": None, "total_steps": 32768, "environments": 256}, "evaluation": {"episodes": 64}}

SINGLES = [name for name in kestrel_drones.task_paths() if name not in TEAMS]

# One of each family, for the quick form.
SAMPLE = ["hover", "cross", "hover-cf2x", "room-1", "room-2-vision", "land", "hover-as-published", "stream-03"]

WHOLE = os.environ.get("WHOLE") == "1"


@pytest.fixture(scope="session")
def run(tmp_path_factory):
    return kestrel_drones.train("hover", seed=1, out=tmp_path_factory.mktemp("runs") / "tiny", **TINY)


@pytest.fixture(scope="session")
def remembering(tmp_path_factory):
    training = {**TINY["training"], "memory": {"units": 8, "steps_per_window": 4}}
    out = tmp_path_factory.mktemp("runs") / "remembering"
    return kestrel_drones.train("hover", seed=1, out=out, **{**TINY, "training": training})


def random_flight(steps, **keywords):
    """Everything that an environment says during so many random steps."""
    envs = kestrel_drones.make_vec("hover", **{"num_envs": 200, **SHORT, **keywords})
    observations, _ = envs.reset()
    random = np.random.default_rng(3)
    said = [observations]
    for _ in range(steps):
        said += envs.step(random.uniform(-1, 1, envs.action_space.shape))[:4]
    return said


def same(one, other):
    return all(a.tobytes() == b.tobytes() for a, b in zip(one, other, strict=True))


def test_every_shipped_task_is_registered_and_no_team():
    for name in kestrel_drones.task_paths():
        assert (task_id(name) in gymnasium.registry) == (name not in TEAMS)
    assert gymnasium.spec("kestrel/Room1-v0").kwargs == {"config": "room-1"}


@pytest.mark.parametrize("name", kestrel_drones.task_paths())
def test_every_shipped_task_is_what_its_interface_needs(name):
    assert (load(name, {}).agents > 1) == (name in TEAMS)


@pytest.mark.parametrize("name", SINGLES if WHOLE else SAMPLE)
def test_gymnasium_finds_no_fault(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # Observations have no limits, and say so.
        warnings.filterwarnings("ignore", message=".*A Box observation space (min|max)imum value is.*")
        check_env(gymnasium.make(task_id(name)).unwrapped)


@pytest.mark.parametrize("name", SINGLES if WHOLE else SAMPLE)
def test_gymnasium_makes_many(name):
    envs = gymnasium.make_vec(task_id(name), num_envs=70)
    observations, infos = envs.reset(seed=1)
    assert observations in envs.observation_space and infos == {}
    envs.action_space.seed(1)
    observations, rewards, terminations, truncations, infos = envs.step(envs.action_space.sample())
    assert observations in envs.observation_space
    assert rewards.shape == terminations.shape == truncations.shape == (70,)
    assert rewards.dtype == np.float32 and terminations.dtype == truncations.dtype == bool


@pytest.mark.parametrize("name", sorted(TEAMS) if WHOLE else ["multi-hover", "crossing-3", "multi-cross", "swarm"])
def test_pettingzoo_finds_no_fault(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        parallel_api_test(kestrel_drones.parallel_env(name), num_cycles=200)


def test_a_drone_that_ends_alone_leaves_its_team():
    env = kestrel_drones.parallel_env("multi-cross")
    env.reset(seed=1)
    falling = {"drone_1": np.full(4, -1.0)}
    while len(env.agents) == 3:
        observations, _, terminations, truncations, infos = env.step({a: falling.get(a, np.zeros(4)) for a in env.agents})
    assert env.agents == ["drone_0", "drone_2"] and terminations["drone_1"] and not truncations["drone_1"]
    assert "ending" in infos["drone_1"] and "ending" not in infos["drone_0"] and len(observations) == 3
    assert set(env.step({agent: np.zeros(4) for agent in env.agents})[0]) == {"drone_0", "drone_2"}


def test_the_same_seed_gives_the_same_bits_for_any_number_of_threads():
    reference = random_flight(60, threads=1, seed=5)
    for threads in (2, 3, None):
        assert same(reference, random_flight(60, threads=threads, seed=5))
    assert not same(reference, random_flight(60, threads=1, seed=6))


def test_a_step_in_two_halves_is_the_same_step():
    whole, halves = (kestrel_drones.make_vec("hover", num_envs=8, seed=3) for _ in range(2))
    first = [envs.reset()[0] for envs in (whole, halves)]
    np.testing.assert_array_equal(*first)
    actions = np.full((8, 4), 0.2, np.float32)
    for _ in range(3):
        halves.send(actions)
        expected = whole.step(actions)
        with pytest.raises(RuntimeError, match="not received"):
            halves.send(actions)
        for mine, other in zip(halves.recv()[:4], expected[:4], strict=True):
            np.testing.assert_array_equal(mine, other)
    with pytest.raises(RuntimeError, match="no step that was sent"):
        halves.recv()
    halves.close()


def test_a_controller_observes_what_the_task_shows():
    envs = kestrel_drones.make_vec("hover", num_envs=64, seed=3, **SHORT)
    controller = kestrel_drones.Controller("hover", drones=64)
    random = np.random.default_rng(3)
    observations, ended = envs.reset()[0], 0
    for _ in range(100):
        np.testing.assert_array_equal(controller.observe(envs.states("known")), observations)
        actions = random.uniform(-1, 1, (64, 4)).astype(np.float32)
        speeds = controller.rotor_speeds(actions)
        assert speeds.shape == (64, 4) and (speeds >= 0).all()
        observations, _, terminations, truncations, _ = envs.step(actions)
        controller.clear(terminations | truncations)
        ended += (terminations | truncations).sum()
    assert ended > 64


def test_an_onnx_file_flies_a_drone_that_takes_rotor_speeds():
    keys = {"scenario.action": {"rotor_speeds": {"fraction_of_hover": 1.0}}}
    envs = kestrel_drones.make_vec("hover", num_envs=64, seed=3, starts="evaluation", **keys)
    envs.reset()
    hovering = kestrel_drones.Controller("hover", **keys).rotor_speeds(np.zeros(4))
    network = onnxruntime.InferenceSession(FOREIGN / "sb3-ppo.onnx")
    controller = kestrel_drones.Controller("hover", drones=64)
    successes = []
    while len(successes) < 64:
        observations = controller.observe(envs.states("known"))
        # Its file takes one observation at a time.
        actions = [network.run(None, {network.get_inputs()[0].name: row[None]})[0][0] for row in observations]
        speeds = controller.rotor_speeds(actions)
        _, _, terminations, truncations, infos = envs.step(speeds / hovering - 1)
        ended = terminations | truncations
        controller.clear(ended)
        if ended.any():
            successes += list(infos["final_info"]["is_success"][ended])
    assert np.mean(successes[:64]) >= 0.9


def test_between_two_actions_a_rate_loop_follows_the_gyroscope():
    keys = {"scenario.action": {"thrust_body_rates": {"rate_loop": {}}}}
    controller, held = kestrel_drones.Controller("hover", 2, **keys), kestrel_drones.Controller("hover", 2)
    for pilot in (controller, held):
        pilot.observe(states_at_rest(2))
    speeds = [pilot.rotor_speeds(np.zeros((2, 4))) for pilot in (controller, held)]
    np.testing.assert_allclose(controller.follow_rates(np.zeros((2, 3))), speeds[0], rtol=1e-6)
    # The left rotors push against a roll to the left, which is negative.
    rolling = controller.follow_rates([[0, 0, 0], [-1, 0, 0]])
    np.testing.assert_allclose(rolling[0], speeds[0][0], rtol=1e-6)
    assert (abs(rolling[1] - speeds[0][1]) > 1).all() and rolling[1].sum() == pytest.approx(speeds[0][1].sum(), rel=1e-3)
    assert held.follow_rates(np.zeros((2, 3))) is None


def states_at_rest(drones):
    still = {name: np.zeros((drones, 3)) for name in ["position_m", "velocity_m_per_s", "body_rates_rad_per_s", "goal_m"]}
    return {**still, "attitude_wxyz": np.tile([1, 0, 0, 0], (drones, 1))}


@pytest.mark.parametrize(
    ("use", "message"),
    [
        (lambda pilot: pilot.observe({"position_m": [0, 0, 0]}), "states: found no attitude_wxyz, expected position_m, "),
        (
            lambda pilot: pilot.observe({**states_at_rest(2), "goal_m": np.zeros(3)}),
            r"goal_m: found \[1, 3\], expected \[2, 3\]",
        ),
        (lambda pilot: pilot.observe(states_at_rest(2), yaw_rad=[0, 1, 2]), r"yaw_rad: found \[3, 1\], expected \[2, 1\]"),
        (
            lambda pilot: pilot.observe(states_at_rest(2), measurements=np.zeros((3, 1))),
            "rows of measurements: found 3, expected 2: one for each drone",
        ),
        (lambda pilot: pilot.rotor_speeds(np.zeros((2, 3))), r"actions: found \[2, 3\], expected \[2, 4\]"),
        (lambda pilot: pilot.clear([True]), "rows: found 1, expected 2: one for each drone"),
    ],
)
def test_a_controller_says_what_it_expects(use, message):
    with pytest.raises(KestrelError, match=message):
        use(kestrel_drones.Controller("hover", 2))


def test_an_environment_does_not_depend_on_how_many_there_are():
    few, many = (kestrel_drones.make_vec("hover", num_envs=count, seed=5).reset()[0] for count in (3, 300))
    assert few.tobytes() == many[:3].tobytes()


def test_an_episode_begins_anew_in_the_step_that_ends_it():
    envs = kestrel_drones.make_vec("hover", num_envs=130, seed=2, **SHORT)
    assert envs.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    single = kestrel_drones.make("hover", **SHORT)
    observation, _ = single.reset(seed=2)
    assert observation.tobytes() == envs.reset()[0][0].tobytes()
    random = np.random.default_rng(4)
    ends = 0
    while ends < 3:
        actions = random.uniform(-1, 1, envs.action_space.shape).astype(np.float32)
        observations, rewards, terminations, truncations, infos = envs.step(actions)
        observation, reward, terminated, truncated, info = single.step(actions[0])
        assert (reward, terminated, truncated) == (rewards[0], terminations[0], truncations[0])
        ended = terminations | truncations
        assert ended.any() == ("final_obs" in infos)
        if ended.any():
            assert (infos["_final_obs"] == ended).all() and (infos["_final_info"] == ended).all()
            assert all((value is not None) == end for value, end in zip(infos["final_obs"], ended, strict=True))
        if not ended[0]:
            assert observation.tobytes() == observations[0].tobytes()
            continue
        ends += 1
        final = infos["final_info"]
        assert observation.tobytes() == infos["final_obs"][0].tobytes()
        assert (info["is_success"], info["ending"]) == (final["is_success"][0], final["ending"][0])
        terms = {name: final["episode_reward_terms"][name][0] for name in info["episode_reward_terms"]}
        assert info["episode_reward_terms"] == terms
        assert single.reset()[0].tobytes() == observations[0].tobytes()


def test_rewards_are_the_sum_of_their_terms():
    env = kestrel_drones.make("hover-cf2x")
    env.reset(seed=0)
    for _ in range(20):
        _, reward, _, _, info = env.step(np.zeros(4))
        assert sum(info["reward_terms"].values()) == pytest.approx(reward, abs=1e-6)
    assert {"alive", "proximity", "proximity_2"} < set(info["reward_terms"])


def test_wrappers_of_gymnasium_fit():
    envs = gymnasium.wrappers.vector.RecordEpisodeStatistics(kestrel_drones.make_vec("hover", num_envs=64, **SHORT))
    envs = gymnasium.wrappers.vector.ClipReward(envs, -1, 1)
    envs.reset(seed=0)
    for _ in range(25):
        infos = envs.step(envs.action_space.sample())[-1]
        if "episode" in infos:
            return
    raise AssertionError("no episode ended")


def test_what_a_step_returned_stays_as_it_was():
    envs = kestrel_drones.make_vec("hover", num_envs=64, seed=1)
    before, _ = envs.reset()
    kept = copy.deepcopy(before)
    envs.step(np.zeros(envs.action_space.shape))
    assert before.tobytes() == kept.tobytes()


def test_images_stand_beside_observations():
    envs = kestrel_drones.make_vec("room-1-vision", num_envs=3, seed=1)
    observations, _ = envs.reset()
    assert observations in envs.observation_space
    assert len(np.unique(observations["image"])) > 5


def test_a_picture_shows_the_drone_in_its_world():
    env = gymnasium.make("kestrel/Room1-v0", render_mode="rgb_array")
    env.reset(seed=0)
    before = env.render()
    assert before.shape == (240, 320, 3) and before.dtype == np.uint8 and len(np.unique(before)) > 20
    for _ in range(20):
        env.step(np.full(env.action_space.shape, 0.2, dtype=np.float32))
    assert (env.render() != before).mean() > 0.05
    envs = gymnasium.make_vec("kestrel/Hover-v0", num_envs=2, render_mode="rgb_array")
    envs.reset(seed=0)
    assert len(envs.render()) == 2


def test_critics_may_know_more():
    envs = kestrel_drones.make_vec("hover", num_envs=5, seed=1)
    envs.reset()
    assert envs.privileged().shape[0] == 5 and envs.privileged().shape[1] > 0


def test_the_true_state_moves_as_mechanics_says():
    envs = kestrel_drones.make_vec("hover", num_envs=300, seed=1, threads=2)
    envs.reset()
    before, secs = envs.states(), 1 / envs.task.control_rate_hz
    envs.step(np.zeros(envs.action_space.shape))
    after = envs.states()
    assert {name: rows.shape for name, rows in before.items()} == {
        "position_m": (300, 3),
        "attitude_wxyz": (300, 4),
        "rotation": (300, 3, 3),
        "velocity_m_per_s": (300, 3),
        "body_rates_rad_per_s": (300, 3),
        "rotor_speeds_rad_per_s": (300, 4),
        "goal_m": (300, 3),
    }
    assert all(rows.dtype == np.float32 for rows in before.values())
    mean_velocity = (before["velocity_m_per_s"] + after["velocity_m_per_s"]) / 2
    assert after["position_m"] - before["position_m"] == pytest.approx(mean_velocity * secs, abs=3e-3)
    rotation = before["rotation"]
    assert rotation @ rotation.transpose(0, 2, 1) == pytest.approx(np.tile(np.eye(3), (300, 1, 1)), abs=1e-5)
    w, x, y, z = before["attitude_wxyz"].T
    up = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    assert rotation[:, :, 2].T == pytest.approx(up, abs=1e-5)
    # Body rates turn the body's axes: the derivative of R is R [rates]x.
    rates = (before["body_rates_rad_per_s"] + after["body_rates_rad_per_s"]) / 2
    middle = (before["rotation"] + after["rotation"]) / 2
    turned = middle @ np.stack([np.cross(np.eye(3), rate) for rate in rates]) * secs
    assert after["rotation"] - before["rotation"] == pytest.approx(turned, abs=0.01)
    assert (before["goal_m"] == [0, 0, 1]).all()


def test_a_state_is_known_as_late_as_the_task_says():
    late = {"scenario": {"latency": {"state_secs": [0.02, 0.02]}}}
    envs = kestrel_drones.make_vec("hover", num_envs=5, seed=1, **late)
    envs.reset()
    true = envs.states()
    envs.step(np.zeros(envs.action_space.shape))
    assert envs.states("known")["position_m"] == pytest.approx(true["position_m"], abs=1e-6)
    assert (envs.states()["position_m"] != true["position_m"]).any()


def test_one_environment_has_the_state_of_the_first_of_many():
    env, envs = kestrel_drones.make("hover"), kestrel_drones.make_vec("hover", num_envs=3, seed=4)
    env.reset(seed=4)
    envs.reset()
    for name, value in env.state().items():
        assert value.tobytes() == envs.states()[name][0].tobytes()


def test_a_team_has_the_state_of_each():
    team = kestrel_drones.parallel_env("multi-hover")
    team.reset(seed=1)
    states = team.states()
    assert list(states) == team.possible_agents
    places = [state["position_m"] for state in states.values()]
    assert places[0].shape == (3,) and (places[0] != places[1]).any()


def test_a_shipped_airframe_flies_at_another_rate():
    airframe = {"scenario.vehicle.airframe": {"import": str(kestrel_drones.airframe_path("x500"))}}
    scenario = {"physics": {"control_rate_hz": 100, "substeps": 10}}
    actions = {"scenario.action": {"rotor_speeds": {"fraction_of_hover": 0.25}}}
    envs = kestrel_drones.make_vec("hover-cf2x", num_envs=2, scenario=scenario, **airframe, **actions)
    envs.reset()
    assert envs.task.control_rate_hz == 100
    # At its hover speed, which the rotors of an X500 turn at.
    weight = 2.064307692307692 * 9.8
    speed = np.sqrt(weight / 4 / 8.54858e-6)
    assert envs.states()["rotor_speeds_rad_per_s"] == pytest.approx(np.full((2, 4), speed), rel=0.3)


def test_other_threads_of_python_go_on_while_drones_fly():
    envs = kestrel_drones.make_vec("room-1", num_envs=4096, threads=1)
    envs.reset()
    counted, done = [0], threading.Event()

    def count():
        while not done.is_set():
            counted[0] += 1
            time.sleep(1e-4)

    counter = threading.Thread(target=count)
    counter.start()
    actions = np.zeros(envs.action_space.shape, dtype=np.float32)
    begun = time.monotonic()
    while time.monotonic() - begun < 0.5:
        envs.step(actions)
    done.set()
    counter.join()
    assert counted[0] > 100, counted


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: kestrel_drones.make_vec("hovver"), "hovver: found no such task, expected .* such as hover"),
        (lambda: kestrel_drones.make_vec("none.yaml"), "none.yaml: .*expected a configuration"),
        (lambda: kestrel_drones.make_vec("multi-hover"), "found a team of 2 drones, expected one drone: .*parallel_env"),
        (lambda: kestrel_drones.make_vec("hover", num_envs=0), "num_envs: found 0, expected 1 to"),
        (lambda: kestrel_drones.make_vec("hover", threads=0), "threads: found 0, expected 1 or more"),
        (lambda: kestrel_drones.make("hover", render_mode="human"), "render_mode: found human, expected rgb_array"),
        (lambda: kestrel_drones.make_vec("hover", starts="late"), "starts: found late, expected training or evaluation"),
        (lambda: kestrel_drones.make_vec("hover", training={"epochs": -1}), "--set training.epochs=-1: found -1"),
        (lambda: kestrel_drones.make_vec("hover").step(np.zeros((1, 4))), "found no reset before it"),
        (lambda: kestrel_drones.make_vec("hover").states(), "states: found no reset before it"),
        (lambda: kestrel_drones.make_vec("hover").states("late"), "states: found late, expected true or known"),
        (lambda: kestrel_drones.airframe_path("cf3x"), "cf3x: found no such airframe, expected .*cf2x, "),
        (lambda: kestrel_drones.make_vec({"version": 1, "nome": 2}), "configuration:1.*unknown key `nome`"),
        (lambda: kestrel_drones.train("multi-hover", training={"environments": 100}), "expected a multiple of"),
        (lambda: kestrel_drones.Policy.load("none.kestrel"), "none.kestrel: "),
        (lambda: kestrel_drones.Policy.load("hover").act(np.zeros(3)), r"observations: found \[1, 3\], expected"),
        (lambda: kestrel_drones.evaluate("nowhere"), "nowhere holds no run"),
    ],
)
def test_errors_say_where_what_and_what_was_expected(make, message):
    with pytest.raises(KestrelError, match=message):
        make()


def test_actions_of_another_shape_are_refused():
    envs = kestrel_drones.make_vec("hover", num_envs=5)
    envs.reset()
    with pytest.raises(KestrelError, match=r"actions: found \[5, 3\], expected \[5, 4\]"):
        envs.step(np.zeros((5, 3)))


def test_a_file_and_a_dictionary_are_the_same_task(tmp_path):
    own = {
        "version": 1,
        "name": "own",
        "import": str(kestrel_drones.task_path("hover")),
        **SHORT,
    }
    path = tmp_path / "own.yaml"
    path.write_text(json.dumps(own), encoding="utf-8")
    files = [kestrel_drones.make_vec(config, num_envs=2, seed=1) for config in (own, path, str(path))]
    assert len({envs.task.yaml for envs in files}) == 1
    assert len({envs.reset()[0].tobytes() for envs in files}) == 1


def test_a_run_directory_holds_what_kestrel_train_makes(run):
    names = {path.name for path in run.path.iterdir()}
    expected = {"config.yaml", "metrics.jsonl", "checkpoints", "policy.kestrel", "policy-f32.kestrel", "evaluation.json"}
    assert expected | {"learning-curve.svg", "flight.gif", "export.json"} <= names
    assert [row["updates"] for row in run.rows] == list(range(1, 5)) and run.rows[-1]["steps"] == 32768
    assert run.evaluation["rows"][0]["pilot"] == "fixed16"


def test_the_same_seed_trains_the_same_policy(run, tmp_path):
    again = kestrel_drones.train("hover", seed=1, out=tmp_path / "again", threads=1, **TINY)
    assert (again.path / "policy.kestrel").read_bytes() == (run.path / "policy.kestrel").read_bytes()


def assert_flies_as_in_rust(run, index):
    report = kestrel_drones.evaluate(run)["rows"][index]
    policy = kestrel_drones.Policy.load(run.path / ["policy.kestrel", "policy-f32.kestrel"][index])
    assert policy.arithmetic == report["pilot"]
    envs = kestrel_drones.make_vec(run.path / "config.yaml", num_envs=64, starts="evaluation", seed=0)
    memory = policy.memory(64) if policy.is_recurrent else None
    observations, _ = envs.reset()
    returns = np.full(64, np.nan)
    total, success = np.zeros(64, np.float32), np.zeros(64, bool)
    while np.isnan(returns).any():
        observations, rewards, terminations, truncations, infos = envs.step(policy.act(observations, memory))
        if memory is not None:
            memory.clear(terminations | truncations)
        total += rewards
        first = (terminations | truncations) & np.isnan(returns)
        if first.any():
            returns[first] = total[first]
            success[first] = infos["final_info"]["is_success"][first]
    assert returns.sum() / 64 == report["episode_return"]
    assert success.mean() == report["success_rate"]


@pytest.mark.parametrize("index", [0, 1])
def test_a_policy_flies_in_python_as_in_the_evaluation_of_rust(run, index):
    assert_flies_as_in_rust(run, index)


@pytest.mark.parametrize("index", [0, 1])
def test_a_recurrent_policy_remembers_in_python_as_in_rust(remembering, index):
    assert_flies_as_in_rust(remembering, index)


def test_a_recurrent_policy_wants_the_memory_of_as_many_rows(remembering):
    policy = remembering.policy
    observations, _ = kestrel_drones.make_vec(remembering.path / "config.yaml", num_envs=3).reset()
    with pytest.raises(kestrel_drones.KestrelError, match="memory: found None, expected"):
        policy.act(observations)
    with pytest.raises(kestrel_drones.KestrelError, match="memory: found 2, expected 3 rows"):
        policy.act(observations, policy.memory(2))
    memory = policy.memory(3)
    first = policy.act(observations, memory)
    assert (policy.act(observations, memory) != first).any()
    memory.clear([True, True, True])
    assert (policy.act(observations, memory) == first).all()
    with pytest.raises(kestrel_drones.KestrelError, match="rows: found 1, expected 3"):
        memory.clear([True])


def test_one_observation_or_many_give_the_same_action():
    policy = kestrel_drones.Policy.load("hover")
    observations, _ = kestrel_drones.make_vec("hover", num_envs=4, seed=1).reset()
    assert (policy.act(observations[2]) == policy.act(observations)[2]).all()


def test_policies_are_exported(run):
    for target in ("file", "rust", "c", "crazyflie", "betaflight", "onnx", "safetensors"):
        assert all(path.exists() for path in kestrel_drones.export(run, target))
    with pytest.raises(KestrelError, match="target: found cobol, expected file, rust"):
        kestrel_drones.export(run, "cobol")


def test_whoever_watches_is_told_and_may_end_it(tmp_path):
    seen = []

    def watch(run):
        seen.append(len(run.rows))
        if len(seen) == 2:
            raise LookupError("enough")

    with pytest.raises(LookupError, match="enough"):
        kestrel_drones.train("hover", out=tmp_path / "run", watch=watch, training={"analytic": None, "total_steps": 10**9})
    assert len(seen) == 2 and seen[1] >= seen[0]
    assert any((tmp_path / "run/checkpoints").iterdir())


def test_ctrl_c_stops_with_a_checkpoint_from_which_training_goes_on(tmp_path):
    code = """if True:
        import kestrel_drones, signal, sys
        # A shell that starts the tests in the background has them ignore it.
        signal.signal(signal.SIGINT, signal.default_int_handler)
        try:
            kestrel_drones.train("hover", out=sys.argv[1], training={"analytic": None, "total_steps": 4_000_000, "environments": 256})
        except KeyboardInterrupt:
            print("interrupted")
    """
    out = tmp_path / "stopped"
    child = subprocess.Popen([sys.executable, "-c", code, out], stdout=subprocess.PIPE, text=True)
    metrics = out / "metrics.jsonl"
    while not metrics.exists() or not metrics.read_text():
        assert child.poll() is None
        time.sleep(0.05)
    child.send_signal(signal.SIGINT)
    assert child.communicate(timeout=30)[0] == "interrupted\n"
    rows = kestrel_drones.Run(out).rows
    config = out / "config.yaml"
    budget = rows[-1]["steps"] + 8192
    config.write_text(config.read_text().replace("total_steps: 4000000", f"total_steps: {budget}"))
    assert kestrel_drones.resume(out).rows[-1]["steps"] == budget


FOREIGN = Path(__file__).parent.parent / "golden" / "foreign"


def state_dict():
    """The tensors of tests/golden/foreign/sb3-ppo.safetensors."""
    file = (FOREIGN / "sb3-ppo.safetensors").read_bytes()
    behind = 8 + int.from_bytes(file[:8], "little")
    header = json.loads(file[8:behind])
    header.pop("__metadata__", None)
    data = np.frombuffer(file[behind:], dtype=np.uint8)
    return {name: data[slice(*at["data_offsets"])].view("<f4").reshape(at["shape"]) for name, at in header.items()}


@pytest.mark.parametrize("source", [FOREIGN / "sb3-ppo.onnx", FOREIGN / "sb3-ppo.safetensors", state_dict()])
def test_a_network_of_stable_baselines_is_imported(source, tmp_path):
    predicted = json.loads((FOREIGN / "sb3-ppo.json").read_text())
    observations, actions = (np.array(predicted[name], np.float32) for name in ("observations", "actions"))
    small = {"evaluation": {"episodes": 64}}
    policy = kestrel_drones.import_policy(source, "hover", out=tmp_path / "run", **small)
    assert policy.arithmetic == "fixed16" and np.abs(policy.act(observations) - actions).max() < 2e-3
    float_policy = kestrel_drones.Policy.load(tmp_path / "run" / "policy-f32.kestrel")
    assert np.abs(float_policy.act(observations) - actions).max() < 2e-6
    assert kestrel_drones.Run(tmp_path / "run").evaluation["rows"][0]["success_rate"] > 0.5
    again = kestrel_drones.import_policy(source, "hover", **small)
    assert (again.act(observations) == policy.act(observations)).all()


def test_networks_that_do_not_fit_are_refused_by_tensor():
    with pytest.raises(KestrelError, match=r"tensor action_net.bias: found float64, expected F32"):
        kestrel_drones.import_policy({**state_dict(), "action_net.bias": np.zeros(4)}, "hover")
    with pytest.raises(KestrelError, match=r"tensor action_net.bias: found \[3\], expected \[4\]"):
        kestrel_drones.import_policy({**state_dict(), "action_net.bias": np.zeros(3, np.float32)}, "hover")
    with pytest.raises(KestrelError, match="none.onnx: cannot be read"):
        kestrel_drones.import_policy("none.onnx", "hover")
    with pytest.raises(KestrelError, match="activation: found gelu, expected tanh or relu"):
        kestrel_drones.import_policy(state_dict(), "hover", activation="gelu")


def test_a_file_of_ones_own_imports_shipped_ones_by_name(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("version: 1\nname: mine\nimport: kestrel:configs/hover.yaml\nscenario: { episode_secs: 4 }\n")
    envs = kestrel_drones.make_vec(str(path), num_envs=2)
    assert envs.single_observation_space.shape == kestrel_drones.make_vec("hover", num_envs=2).single_observation_space.shape
    with pytest.raises(KestrelError, match="configs/nothing.yaml"):
        kestrel_drones.make_vec({"version": 1, "name": "mine", "import": "kestrel:configs/nothing.yaml"}, num_envs=2)


def test_a_studys_flights_are_rows(tmp_path):
    repository = Path(__file__).parents[2]
    command = [repository / "target/debug/kestrel", "study", "run", repository / "tests/command_line/tiny-study.yaml"]
    subprocess.run(
        [*command, "--directory", tmp_path / "tiny", "--set", "seeds.count=1", "--quiet"], check=True, capture_output=True
    )
    study = kestrel_drones.Study(tmp_path / "tiny")
    rows = study.rows
    assert {row["method"] for row in rows} == {"anchor", "joint", "plain", "sharing"} and len(rows) > 20
    assert all(row["success"] in (0, 1) and isinstance(row["episode_return"], (int, float)) for row in rows)
    assert {"steps", "success_rate", "stage"} < set(study.curves[0])
    with pytest.raises(FileNotFoundError, match="expected the directory of a study"):
        kestrel_drones.Study(tmp_path)
