"""What `kestrel export` writes for PX4's neural control: TensorFlow Lite's interpreters compute it, and the module's way from
state to motors flies with it.

    python px4_neural_test.py KESTREL

KESTREL is the path of the binary. Exit status 0 if every check passed.
"""

import json
import math
import pathlib
import re
import shlex
import subprocess
import sys
import tempfile

import numpy
from ai_edge_litert.interpreter import Interpreter, OpResolverType
from safetensors import safe_open
from safetensors.numpy import load_file
from tflite_micro.python.tflite_micro import runtime

ADAPTER = pathlib.Path(__file__).parents[1] / "firmware" / "adapters" / "px4.py"
sys.path.insert(0, str(ADAPTER.parent))
import px4  # noqa: E402  (the adapter)

TOLERANCE = 1e-5
"""Largest error of an output."""

OBSERVATIONS = 10_000

OPERATORS = {"FULLY_CONNECTED", "RELU", "ADD"}
"""That the module's interpreter knows."""

EPISODES = 64
SUCCESS_PERCENT = 95.0


def export(kestrel, run, target):
    """The path that it names last."""
    told = subprocess.run([kestrel, "export", str(run), "--target", target], check=True, capture_output=True, text=True)
    return pathlib.Path(told.stdout.splitlines()[-1])


def actions(tensors, observations):
    """Of the policy, in double precision."""
    modules = sorted({int(name.split(".")[0]) for name in tensors if name[0].isdigit()})
    values = observations.astype(float)
    for module in modules:
        values = values @ tensors[f"{module}.weight"].astype(float).T + tensors[f"{module}.bias"]
        values = numpy.maximum(values, 0.0) if module != modules[-1] else numpy.clip(values, -1.0, 1.0)
    return values


def expected_outputs(values, space, coefficient):
    """What PX4 has to read as the rotor speeds of actions, motor by motor."""
    lowest, highest = space["lowest_rotor_speed"] ** 2, space["rotor_speed_limit"] ** 2
    squared = lowest + (highest - lowest) * (values + 1.0) / 2.0
    return (coefficient / 1e5 * squared / math.tau**2 - 1.0)[:, px4.ROTORS]


class Models:
    """The exported model in both interpreters."""

    def __init__(self, path):
        resolver = OpResolverType.BUILTIN_WITHOUT_DEFAULT_DELEGATES
        self.lite = Interpreter(model_path=str(path), experimental_op_resolver_type=resolver)
        self.lite.allocate_tensors()
        self.micro = runtime.Interpreter.from_file(str(path), arena_size=px4.ARENA_BYTES)

    def operators(self):
        return {operator["op_name"] for operator in self.lite._get_ops_details()}

    def ends(self):
        details = [*self.lite.get_input_details(), *self.lite.get_output_details()]
        return [(list(end["shape"]), end["dtype"]) for end in details]

    def outputs(self, observations):
        source, sink = self.lite.get_input_details()[0]["index"], self.lite.get_output_details()[0]["index"]
        by_lite, by_micro = [], []
        for observation in observations[:, None]:
            self.lite.set_tensor(source, observation)
            self.lite.invoke()
            by_lite.append(self.lite.get_tensor(sink)[0].copy())
            self.micro.set_input(observation, 0)
            self.micro.invoke()
            by_micro.append(self.micro.get_output(0)[0].copy())
        return numpy.array(by_lite), numpy.array(by_micro)


def model_checks(kestrel, run):
    """Names of checks and whether they pass."""
    folder = export(kestrel, run, "px4")
    model = (folder / "control_net.tflite").read_bytes()
    export(kestrel, run, "px4")
    yield "exporting again gives the same model", (folder / "control_net.tflite").read_bytes() == model
    tensors_path = export(kestrel, run, "safetensors")
    tensors = load_file(tensors_path)
    with safe_open(tensors_path, "numpy") as opened:
        about = json.loads(opened.metadata()["kestrel"])
    golden = numpy.abs(actions(tensors, tensors["golden.observations"]) - tensors["golden.actions"]).max()
    yield "the tensors are the policy", golden <= TOLERANCE
    models = Models(folder / "control_net.tflite")
    yield f"PX4 knows the operators {sorted(models.operators())}", models.operators() <= OPERATORS
    single = numpy.float32
    yield "fifteen numbers become four", models.ends() == [([1, 15], single), ([1, 4], single)]
    coefficient = px4.parameters(folder / "kestrel.params")["MC_NN_THRST_COEF"]
    generator = numpy.random.default_rng(1)
    observations = (2.0 * generator.normal(size=(OBSERVATIONS, 15))).astype(single)
    expected = expected_outputs(actions(tensors, observations), about["action"]["RotorThrusts"], coefficient)
    for name, outputs in zip(("TensorFlow Lite", "TFLite Micro"), models.outputs(observations)):
        error = numpy.abs(outputs - expected).max()
        yield f"{name} is within {error:.1e} of the policy on {OBSERVATIONS} observations", error <= TOLERANCE
    commands = px4.Motors(px4.parameters(folder / "kestrel.params")).commands(expected.astype(single))
    yield f"motor commands stay within {commands.min():.4f} and {commands.max():.4f}", \
        commands.min() > 0.0 and commands.max() <= 1.0
    compiled = subprocess.run(["g++", "-std=c++17", "-Wall", "-Wextra", "-Werror", "-c", "control_net.cpp", "-o",
                               str(folder / "control_net.o")], cwd=folder)
    yield "the module's compiler takes the sources", compiled.returncode == 0


def flight_checks(kestrel, run):
    """By the true state, and beside this machine's pilot."""
    folder = run / "px4"
    program = folder / "program"
    program.write_text(f"#!/bin/sh\nexec {shlex.join([sys.executable, str(ADAPTER), str(folder)])}\n")
    program.chmod(0o755)
    told = subprocess.run([kestrel, "evaluate", str(run), "--episodes", str(EPISODES), "--processor", "program",
                           "--image", str(program)], capture_output=True, text=True)
    print(told.stdout, told.stderr)
    success = re.search(r"the program +([0-9.]+) %", told.stdout)
    yield "PX4's inputs and motors fly the simulator to the set-point", \
        told.returncode == 0 and success is not None and float(success[1]) >= SUCCESS_PERCENT


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    kestrel = sys.argv[1]
    passed = failed = 0
    with tempfile.TemporaryDirectory() as place:
        run = pathlib.Path(place) / "run"
        subprocess.run([kestrel, "train", "configs/px4-neural.yaml", "--run", str(run), "--set",
                        "evaluation.episodes=16"], check=True, capture_output=True)
        for name, passes in [*model_checks(kestrel, run), *flight_checks(kestrel, run)]:
            print(f"{'ok     ' if passes else 'FAILED '} {name}")
            passed, failed = passed + bool(passes), failed + (not passes)
    print(f"{passed} passed, {failed} failed")
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
