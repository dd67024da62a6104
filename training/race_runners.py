"""The runner against onnxruntime, tract and torch: one decision, one thread.

Run ``python training/race_runners.py`` in a clone, with a Rust toolchain; it needs
``pip install onnx onnxscript onnxruntime tract`` besides the extra ``train``. All run the same
network on the same values, round by round in turn, and the answers are compared first.
"""

from __future__ import annotations

import argparse
import logging
import os
import re
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("RAYON_NUM_THREADS", "1")  # before any of the runners starts threads

import numpy as np
import onnxruntime
import torch
import tract
from numpy.typing import NDArray
from torch import nn

from lasergym.export import export_module, write_network
from lasergym.sb3.spatial_network import CorrectionNet

logging.getLogger("torch.onnx").setLevel(logging.ERROR)  # it misses torchvision, which is not used

WARM_UP = 50
RUNS = 1000
TOLERANCE = 1e-4
REPOSITORY = Path(__file__).parents[1]

Timed = Callable[[], "tuple[float, float]"]


def networks() -> dict[str, tuple[nn.Module, tuple[int, int, int]]]:
    """Networks with random weights, and the shapes of what they read."""
    spatial = CorrectionNet()
    nn.init.normal_(spatial.out.weight)
    nature = nn.Sequential(
        *(nn.Conv2d(1, 32, 8, stride=4), nn.ReLU(), nn.Conv2d(32, 64, 4, stride=2), nn.ReLU()),
        *(nn.Conv2d(64, 64, 3), nn.ReLU(), nn.Flatten(), nn.Linear(5184, 512), nn.ReLU()),
        nn.Linear(512, 2),
    )
    perceptron = nn.Sequential(
        *(nn.Flatten(), nn.Linear(1200, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh()),
        nn.Linear(64, 2),
    )
    return {
        "spatial policy": (spatial, (18, 28, 28)),
        "CNN of the paper's recipe": (nature, (1, 100, 100)),
        "perceptron, 2 layers of 64": (perceptron, (3, 20, 20)),
    }


def write(module: nn.Module, shape: tuple[int, int, int], stem: Path) -> None:
    """Writes the policy file and the ONNX file of a network."""
    if isinstance(module, CorrectionNet):
        write_network(module.exported(), stem.with_suffix(".safetensors"))
    else:
        export_module(module, stem.with_suffix(".safetensors"), shape)
    torch.onnx.export(
        module,
        (torch.zeros(1, *shape),),
        str(stem.with_suffix(".onnx")),
        input_names=["values"],
        dynamo=True,
        verbose=False,
    )


def percentiles_us(decide: Callable[[], object]) -> tuple[float, float]:
    """Median and 99th percentile of the time of a decision, µs."""
    for _ in range(WARM_UP):
        decide()
    times_us = np.empty(RUNS)
    for run in range(RUNS):
        began_s = time.perf_counter()
        decide()
        times_us[run] = (time.perf_counter() - began_s) * 1e6
    return float(np.percentile(times_us, 50)), float(np.percentile(times_us, 99))


def runner(program: Path, file: Path) -> Timed:
    """Our runner, which times itself in the same way (``examples/time_forward.rs``)."""

    def timed() -> tuple[float, float]:
        printed = subprocess.run([program, file], check=True, capture_output=True, text=True).stdout
        found = re.search(r"p50 ([\d.]+) us, p99 ([\d.]+) us", printed)
        if found is None:
            raise RuntimeError(f"no times in {printed!r}")
        return float(found[1]), float(found[2])

    return timed


def opponents(
    module: nn.Module, file: Path, values: NDArray[np.float32]
) -> dict[str, Callable[[], NDArray[np.float32]]]:
    """What runs the network besides the runner: a decision each, as a function."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    session = onnxruntime.InferenceSession(str(file), options, providers=["CPUExecutionProvider"])
    model = tract.onnx().load(str(file))
    plan = model.into_model().into_runnable()
    tensor = torch.from_numpy(values)
    given = tract.Tensor.from_numpy(values)

    def by_torch() -> NDArray[np.float32]:
        with torch.inference_mode():
            answer: NDArray[np.float32] = module(tensor).numpy()
        return answer

    return {
        "onnxruntime": lambda: session.run(None, {"values": values})[0],
        "tract": lambda: plan.run([given])[0].to_numpy(),
        "torch": by_torch,
    }


def main() -> None:
    """Prints a table row for each network."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rounds", type=int, default=7, help="turns of each runner")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(0)
    build = ["cargo", "build", "--quiet", "--release", "--package", "lasergym-policy"]
    subprocess.run([*build, "--example", "time_forward"], check=True, cwd=REPOSITORY)
    target = Path(os.environ.get("CARGO_TARGET_DIR", REPOSITORY / "target"))
    program = target / "release" / "examples" / "time_forward"
    names = ("lasergym", "onnxruntime", "tract", "torch")
    print("| network | " + " | ".join(names) + " |")
    print("|---|" + "---:|" * len(names))
    with tempfile.TemporaryDirectory() as folder:
        for name, (module, shape) in networks().items():
            module.eval()
            stem = Path(folder) / "network"
            write(module, shape, stem)
            values = np.random.default_rng(0).random((1, *shape), np.float32)
            others = opponents(module, stem.with_suffix(".onnx"), values)
            answers = [decide() for decide in others.values()]
            for answer in answers:
                np.testing.assert_allclose(answer, answers[0], atol=TOLERANCE)
            times: dict[str, list[tuple[float, float]]] = {each: [] for each in names}
            for _ in range(arguments.rounds):
                times["lasergym"].append(runner(program, stem.with_suffix(".safetensors"))())
                for other, decide in others.items():
                    times[other].append(percentiles_us(decide))
            cells = [
                " / ".join(f"{statistics.median(part):.0f}" for part in zip(*rounds, strict=True))
                for rounds in times.values()
            ]
            print(f"| {name} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
