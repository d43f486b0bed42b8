"""Checks that ONNX Runtime, numpy and PyTorch compute the actions of exported actors.

    python check.py --trainer target/release/trainer [--policy policy.bin]

Exports the policy (by default the shipped one), evaluates it on 10,000 observations in each
library, and compares the actions with `trainer infer`; then the same weights with every other
activation, between the layers and at the end. The exit status is 1 unless 99.9 % of
the actions for observations within a leg's range are within 1e-6 of the actions' range, all
of them within 3e-6, and all for observations up to a million times larger within 1e-4; with
the other activations 99.5 %, 3e-6 and 2e-4, for each library has its own exp and tanh. Each
library sums in its own order in f32, which shows where large sums cancel. torch is checked
where it is installed.
"""

import argparse
import csv
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
from safetensors import safe_open
from safetensors.numpy import load_file, save_file

# Tolerances, as shares of the actions' ranges.
USUAL = 1e-6
WORST = 3e-6
SHARE_WITHIN_USUAL = 0.999
WORST_FAR_OUT = 1e-4
# The same with other activations, which libraries compute by functions of their own.
OTHER_SHARE_WITHIN_USUAL = 0.995
OTHER_WORST_FAR_OUT = 2e-4
# Number of observations outside a leg's range.
FAR_OUT = 96


def observations(count=10_000):
    """Returns vx within 11 m/s, y from 1 to 12.5 m, rho from 0 to 1; their corners; and far out."""
    rng = np.random.default_rng(7)
    inner = rng.uniform([-11, 1, 0], [11, 12.5, 1], (count - FAR_OUT - 12, 3))
    corners = np.array([[vx, y, rho] for vx in (-11, 0, 11) for y in (1, 12.5) for rho in (0, 1)])
    far = rng.normal(size=(FAR_OUT, 3)) * 10.0 ** rng.integers(-6, 7, (FAR_OUT, 1))
    return np.concatenate([inner, corners, far]).astype(np.float32)


# Activations of an actor beside those of the shipped one, in f32.
GELU_SLOPE = np.float32((2 / np.pi) ** 0.5)
HIDDEN = {
    "relu": lambda z: np.maximum(z, 0),
    "leaky_relu(0.01)": lambda z: np.where(z > 0, z, np.float32(0.01) * z),
    "elu(1)": lambda z: np.where(z > 0, z, np.expm1(np.minimum(z, 0))),
    "tanh": np.tanh,
    "silu": lambda z: z * (np.float32(0.5) + np.float32(0.5) * np.tanh(np.float32(0.5) * z)),
    "gelu_tanh": lambda z: z
    * (np.float32(0.5) + np.float32(0.5) * np.tanh(GELU_SLOPE * (z + np.float32(0.044715) * z * z * z))),
}


def card_of(path):
    with safe_open(path, "np") as file:
        return json.loads(file.metadata()["leg_actor"])


def is_squashed(card):
    return "tanh" in card["output"]


def in_numpy(path, x):
    with safe_open(path, "np") as file:
        card = json.loads(file.metadata()["leg_actor"])
        tensors = {name: file.get_tensor(name) for name in file.keys()}
    f32 = lambda numbers: np.array(numbers, np.float32)
    x = (x - f32(card["observation"]["offset"])) * f32(card["observation"]["scale"])
    indices = sorted({int(name.split(".")[0]) for name in tensors})
    for i in indices:
        x = x @ tensors[f"{i}.weight"].T + tensors[f"{i}.bias"]
        if i != indices[-1]:
            x = HIDDEN[card["hidden_activation"]](x)
        elif is_squashed(card):
            x = np.tanh(x)
    action = card["action"]
    x = f32(action["offset"]) + f32(action["scale"]) * x
    return np.clip(x, f32(action["low"]), f32(action["high"]))


def in_torch(path, x):
    import torch
    from safetensors.torch import load_file as load_tensors

    torch.set_num_threads(1)
    card = card_of(path)
    modules = {
        "relu": torch.nn.ReLU(),
        "leaky_relu(0.01)": torch.nn.LeakyReLU(0.01),
        "elu(1)": torch.nn.ELU(),
        "tanh": torch.nn.Tanh(),
        "silu": torch.nn.SiLU(),
        "gelu_tanh": torch.nn.GELU(approximate="tanh"),
    }
    tensors = load_tensors(path)
    layers = []
    for i in sorted({int(name.split(".")[0]) for name in tensors}):
        outputs, inputs = tensors[f"{i}.weight"].shape
        layers += [torch.nn.Linear(inputs, outputs), modules[card["hidden_activation"]]]
    layers[-1] = torch.nn.Tanh() if is_squashed(card) else torch.nn.Identity()
    network = torch.nn.Sequential(*layers)
    network.load_state_dict(tensors)
    t = {key: {k: torch.tensor(v) for k, v in card[key].items()} for key in ("observation", "action")}
    o, a = t["observation"], t["action"]
    with torch.no_grad():
        u = network((torch.from_numpy(x) - o["offset"]) * o["scale"])
        return torch.clamp(a["offset"] + a["scale"] * u, a["low"], a["high"]).numpy()


def in_onnxruntime(path, x):
    onnx.checker.check_model(path, full_check=True)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    whole = session.run(["action"], {"observation": x})[0]
    one = session.run(["action"], {"observation": x[:1]})[0]
    assert one.shape == (1, 2), "the batch size is fixed"
    return whole


def check(run, folder, policy, x):
    """Compares the actions of one policy; returns whether they differ too much."""
    for name, to in [("a.safetensors", "safetensors"), ("a.onnx", "onnx")]:
        run("export", *policy, "--to", to, folder / name)
    # `infer` reads a policy file, so the export is imported again.
    run("import", "--onnx", folder / "a.onnx", "--out", folder / "a.bin")
    run("infer", "--policy", folder / "a.bin", "--input", folder / "o.csv", "--output", folder / "a.csv")
    rows = np.loadtxt(folder / "a.csv", delimiter=",", skiprows=1, dtype=np.float64)
    assert np.array_equal(rows[:, :3].astype(np.float32), x), "the observations changed in the CSV files"
    card = card_of(folder / "a.safetensors")
    print(f"{card['hidden_activation']}, {card['output']}")
    action = card["action"]
    span = np.array(action["high"]) - np.array(action["low"])
    ways = {
        "ONNX Runtime": lambda: in_onnxruntime(str(folder / "a.onnx"), x),
        "numpy": lambda: in_numpy(folder / "a.safetensors", x),
        "torch": lambda: in_torch(folder / "a.safetensors", x),
    }
    is_relu = card["hidden_activation"] == "relu"
    share = SHARE_WITHIN_USUAL if is_relu else OTHER_SHARE_WITHIN_USUAL
    worst_far = WORST_FAR_OUT if is_relu else OTHER_WORST_FAR_OUT
    failed = False
    for name, way in ways.items():
        try:
            found = way()
        except ModuleNotFoundError as missing:
            print(f"{name:12}  SKIPPED: {missing}")
            continue
        off = np.abs(found - rows[:, 3:]) / span
        off = np.where(np.isnan(off), np.inf, off)
        off, far = off[:-FAR_OUT], off[-FAR_OUT:].max()
        usual = (off <= USUAL).mean()
        print(
            f"{name:12}  {len(off)} observations: worst {off.max():.2e} of the range, "
            f"mean {off.mean():.1e}, {usual:.3%} within {USUAL:g}; far out {far:.1e}"
        )
        failed |= off.max() > WORST or usual < share or far > worst_far
    return failed


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trainer", default="trainer", help="the trainer program")
    parser.add_argument("--policy", help="the policy file [default: the shipped one]")
    arguments = parser.parse_args()
    trainer = str(Path(arguments.trainer).resolve()) if "/" in arguments.trainer else arguments.trainer
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        run = lambda *words: subprocess.run([trainer, *map(str, words)], check=True, stdout=subprocess.DEVNULL)
        x = observations()
        with open(folder / "o.csv", "w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(["vx", "y", "rho"])
            writer.writerows([[repr(float(v)) for v in row] for row in x])
        of = ["--policy", arguments.policy] if arguments.policy else []
        failed = check(run, folder, of, x)
        # Without the model card, so that the activations can be stated.
        run("export", *of, "--to", "safetensors", folder / "plain.safetensors")
        save_file(load_file(folder / "plain.safetensors"), folder / "plain.safetensors")
        for hidden, output in [(h, "tanh") for h in list(HIDDEN)[1:]] + [("tanh", "linear")]:
            stated = ["--hidden-activation", hidden, "--output-activation", output, "--ki", "0.05"]
            stated += ["--observation-offset", "0,2.5,0.5", "--observation-scale", "0.33,0.4,2"]
            run("import", "--safetensors", folder / "plain.safetensors", *stated, "--out", folder / "b.bin")
            failed |= check(run, folder, ["--policy", folder / "b.bin"], x)
    if failed:
        sys.exit("the actions differ too much")


if __name__ == "__main__":
    main()
