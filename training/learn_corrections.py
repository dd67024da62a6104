"""Trains a spatial policy on what the annealing planner says about its choices.

Run ``python training/learn_corrections.py random_shape -o runs/random-shape``; it needs
``pip install "lasergym[train]"``. The run can be killed at any time: the same command goes on from
its last checkpoint. It leaves ``policy.safetensors`` and ``history.csv``.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import time
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import torch

import lasergym
from lasergym.comparison import PulseBudget
from lasergym.export import write_network
from lasergym.policy import Policy
from lasergym.training.corrections import CorrectionLearner, CorrectionOptions, Progress
from lasergym.training.teacher import FIRST_VALIDATION_SEED, TeacherTask


def validate(policy: Policy, shapes: int) -> tuple[float, float]:
    """Mean gain over area of the policy and of greedy on random shapes that nobody trains on."""
    budget = PulseBudget(pulses=None, area_per_pulse_px=125.0)
    gains = []
    for seed in range(FIRST_VALIDATION_SEED, FIRST_VALIDATION_SEED + shapes):
        target = lasergym.targets.random_shape(seed=seed)
        area_px = int(target.sum())
        pulses = budget.pulses_for(area_px)
        learned = lasergym.plan(target, "policy", policy=policy, max_pulses=pulses)
        greedy = lasergym.plan(target, "greedy", max_pulses=pulses)
        gains.append((learned.reward * 1e4 / area_px, greedy.reward * 1e4 / area_px))
    ours, greedys = np.mean(gains, axis=0)
    return float(ours), float(greedys)


def export(learner: CorrectionLearner, path: Path, training: dict[str, object]) -> Policy:
    """Writes the policy file and loads it as users do."""
    write_network(learner.network.exported(), path, storage="bfloat16", training=training)
    return Policy.load(path)


def main() -> None:
    """Trains, goes on where a checkpoint lies, and judges."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    names = [task.value for task in TeacherTask]
    parser.add_argument("tasks", nargs="+", choices=names, help="targets to learn from, in turn")
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder of the run")
    parser.add_argument(
        "--updates", type=int, default=CorrectionOptions.updates, help="of the network, in all"
    )
    parser.add_argument("--seed", type=int, default=0, help="everything random derives from it")
    parser.add_argument(
        "--threads", type=int, default=torch.get_num_threads(), help="threads of torch"
    )
    parser.add_argument("--shapes", type=int, default=200, help="random shapes for validation")
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    tasks = tuple(TeacherTask(name) for name in arguments.tasks)
    options = replace(
        CorrectionOptions(), tasks=tasks, updates=arguments.updates, seed=arguments.seed
    )
    learner = CorrectionLearner(options)
    folder: Path = arguments.output
    folder.mkdir(parents=True, exist_ok=True)
    checkpoint = folder / "checkpoint.pt"
    if checkpoint.exists():
        learner.load(checkpoint)
    history = folder / "history.csv"

    def report(progress: Progress) -> None:
        row = asdict(progress) | {"returns": float(np.mean(progress.returns or [math.nan]))}
        fresh = not history.exists()
        with history.open("a", newline="") as file:
            writer = csv.DictWriter(file, list(row))
            if fresh:
                writer.writeheader()
            writer.writerow(row)
        print(
            f"{progress.updates:6} updates, loss {progress.loss:.3f}, regret "
            f"{progress.regret_px:.2f} px (ring score {progress.heuristic_regret_px:.2f}), "
            f"gain / area {row['returns']:.4f}, {progress.elapsed_s:.0f} s",
            flush=True,
        )

    began_s = time.perf_counter()
    learner.learn(report, checkpoint)
    summary = {
        "command": f"python training/learn_corrections.py {' '.join(arguments.tasks)} "
        f"--updates {arguments.updates} --seed {arguments.seed}",
        "updates": learner.updates,
        "last_session_s": round(time.perf_counter() - began_s),
    }
    policy = export(learner, folder / "policy.safetensors", summary)
    ours, greedy = validate(policy, arguments.shapes)
    print(json.dumps(summary | {"policy": ours, "greedy": greedy, "shapes": arguments.shapes}))


if __name__ == "__main__":
    main()
