"""What `kestrel export` writes for other programs: onnxruntime runs it, safetensors and numpy read it.

    python exchange_test.py KESTREL

KESTREL is the path of the binary. PyTorch, where it is installed, reads and runs the weights too. Exit status 0 if every
check passed.
"""

import importlib.util
import json
import pathlib
import subprocess
import sys
import tempfile

import numpy
import onnxruntime
from safetensors import safe_open
from safetensors.numpy import load_file

TOLERANCE = 2e-6
"""Largest error of an action: a few units in the last place of 1."""

RANDOM_OBSERVATIONS = 1000


def export(kestrel, run, target):
    """The paths that it names, and the bytes of the last."""
    told = subprocess.run([kestrel, "export", str(run), "--target", target], check=True, capture_output=True, text=True)
    path = pathlib.Path(told.stdout.splitlines()[-1])
    return path, path.read_bytes()


def by_numpy(tensors, observations):
    modules = sorted({int(name.split(".")[0]) for name in tensors if name[0].isdigit()})
    values = observations
    for module in modules:
        values = values @ tensors[f"{module}.weight"].T + tensors[f"{module}.bias"]
        values = numpy.tanh(values) if module != modules[-1] else numpy.clip(values, -1.0, 1.0)
    return values


def by_torch(path, observations):
    import torch
    from safetensors.torch import load_file as load

    tensors = {name: tensor for name, tensor in load(path).items() if not name.startswith("golden")}
    network = torch.nn.Sequential()
    for name, tensor in sorted(tensors.items(), key=lambda item: int(item[0].split(".")[0])):
        module, what = name.split(".")
        if what == "weight":
            if len(network):
                network.append(torch.nn.Tanh())
            network.append(torch.nn.Linear(tensor.shape[1], tensor.shape[0]))
    network.load_state_dict(tensors)
    with torch.no_grad():
        return network(torch.from_numpy(observations)).clip(-1.0, 1.0).numpy()


def checks(kestrel, run):
    """Names of checks and whether they pass."""
    model_path, model = export(kestrel, run, "onnx")
    tensors_path, file = export(kestrel, run, "safetensors")
    yield "exporting again gives the same model", export(kestrel, run, "onnx")[1] == model
    yield "exporting again gives the same tensors", export(kestrel, run, "safetensors")[1] == file
    session = onnxruntime.InferenceSession(model_path, providers=["CPUExecutionProvider"])
    tensors = load_file(tensors_path)
    observations, actions = tensors["golden.observations"], tensors["golden.actions"]

    def acts(observations):
        return session.run(["action"], {"observation": observations})[0]

    def close(found, expected):
        return found.shape == expected.shape and numpy.abs(found - expected).max() <= TOLERANCE

    yield "onnxruntime finds the golden actions", close(acts(observations), actions)
    yield "numpy finds the golden actions", close(by_numpy(tensors, observations), actions)
    generator = numpy.random.default_rng(1)
    random = generator.normal(size=(RANDOM_OBSERVATIONS, observations.shape[1])).astype(numpy.float32)
    yield "onnxruntime and numpy agree on anything", close(acts(random), by_numpy(tensors, random))
    yield "one observation alone is a batch", close(acts(random[:1]), acts(random)[:1])
    about = json.loads(session.get_modelmeta().custom_metadata_map["kestrel"])
    with safe_open(tensors_path, "numpy") as opened:
        yield "both files say the same of the policy", json.loads(opened.metadata()["kestrel"]) == about
    yield "they name the policy and its pace", about["name"] == "hover" and 0.0 < about["control_period_secs"] < 0.1
    if importlib.util.find_spec("torch"):
        yield "PyTorch finds the golden actions", close(by_torch(tensors_path, observations), actions)


def recurrent_checks(kestrel, run):
    """As `checks`, of a policy with a memory: the golden vectors are one flight."""
    model_path, _ = export(kestrel, run, "onnx")
    tensors_path, _ = export(kestrel, run, "safetensors")
    session = onnxruntime.InferenceSession(model_path, providers=["CPUExecutionProvider"])
    tensors = load_file(tensors_path)
    units = len(tensors["memory.candidate.bias"])

    def sigmoid(values):
        return 1.0 / (1.0 + numpy.exp(-values))

    def layer(name, values):
        return values @ tensors[f"memory.{name}.weight"].T + tensors[f"memory.{name}.bias"]

    by_onnx, hidden = [], numpy.zeros((1, units), numpy.float32)
    by_hand, remembered = [], hidden
    for observation in tensors["golden.observations"][:, None]:
        action, hidden = session.run(["action", "next_hidden"], {"observation": observation, "hidden": hidden})
        by_onnx.append(action[0])
        gates = sigmoid(layer("gates", numpy.hstack([observation, remembered])))
        candidate = numpy.tanh(layer("candidate", numpy.hstack([observation, gates[:, :units] * remembered])))
        remembered = candidate + gates[:, units:] * (remembered - candidate)
        by_hand.append(by_numpy(tensors, numpy.hstack([observation, remembered]))[0])
    for name, found in [("onnxruntime", by_onnx), ("numpy", by_hand)]:
        error = numpy.abs(numpy.array(found) - tensors["golden.actions"]).max()
        yield f"{name} remembers what a recurrent policy does", error <= TOLERANCE


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    kestrel = sys.argv[1]
    passed = failed = 0
    with tempfile.TemporaryDirectory() as folder:
        run = pathlib.Path(folder) / "run"
        short = ["--set", "training.analytic.total_steps=102400", "--set", "evaluation.episodes=16"]
        subprocess.run([kestrel, "train", "configs/hover.yaml", "--run", str(run), *short], check=True, capture_output=True)
        other = pathlib.Path(folder) / "recurrent"
        short = ["training.analytic=null", "training.total_steps=32768", "training.environments=256",
                 "training.memory.units=12", "training.memory.steps_per_window=4", "evaluation.episodes=16"]
        short = [word for value in short for word in ("--set", value)]
        subprocess.run([kestrel, "train", "configs/hover.yaml", "--run", str(other), *short], check=True, capture_output=True)
        for name, passes in [*checks(kestrel, run), *recurrent_checks(kestrel, other)]:
            print(f"{'ok     ' if passes else 'FAILED '} {name}")
            passed, failed = passed + bool(passes), failed + (not passes)
    print(f"{passed} passed, {failed} failed")
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
