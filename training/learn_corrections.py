"""Trains a spatial policy on what the annealing planner says about its choices.

Run ``python training/learn_corrections.py random_shape -o runs/random-shape``; it needs
``pip install "lasergym[train]"``. The run can be killed at any time: the same command goes on from
its last checkpoint. It leaves ``policy.safetensors`` and ``history.csv``.
"""

from __future__ import annotations

import argparse
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

import lasergym
from lasergym.policy import Policy
from lasergym.training.correction_options import CorrectionOptions, LessonProgress
from lasergym.training.lessons import learn_from_planner
from lasergym.training.spatial_decision import POLISH_PX
from lasergym.training.teacher import TeacherTask
from lasergym.training.validation import validation_targets


def validate(policy: Policy, tasks: tuple[TeacherTask, ...], targets: int) -> dict[str, float]:
    """Mean gain over area of the policy and of planners on targets of each task."""
    means = {}
    for task in tasks:
        gains = []
        for target, pulses in validation_targets(task, targets):
            plans = (
                lasergym.plan(target, "greedy", max_pulses=pulses),
                lasergym.plan(target, "policy", policy=policy, max_pulses=pulses),
                lasergym.plan(target, "anneal", max_pulses=pulses, iterations=1_000_000),
            )
            gains.append([plan.reward * 1e4 / int(target.sum()) for plan in plans])
        for planner, mean in zip(("greedy", "policy", "anneal"), np.mean(gains, 0), strict=True):
            means[f"{task.value} {planner}"] = round(float(mean), 5)
    return means


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
        "--learning-rate", type=float, default=CorrectionOptions.learning_rate, help="at the start"
    )
    parser.add_argument(
        "--begin-with", type=Path, metavar="POLICY", help="policy file to learn on from"
    )
    parser.add_argument(
        "--jobs", type=int, default=CorrectionOptions.jobs, help="that go on side by side"
    )
    parser.add_argument(
        "--moves", type=int, default=CorrectionOptions.moves, help="for each candidate"
    )
    parser.add_argument(
        "--lessons-per-judgement",
        type=int,
        default=CorrectionOptions.lessons_per_judgement,
        help="lessons between two validations",
    )
    parser.add_argument(
        "--polish-px",
        type=float,
        default=POLISH_PX,
        help="range of the polish of the policy that is written",
    )
    parser.add_argument(
        "--threads", type=int, default=torch.get_num_threads(), help="threads of torch"
    )
    parser.add_argument("--targets", type=int, default=200, help="validation targets of each task")
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    tasks = tuple(TeacherTask(name) for name in arguments.tasks)
    options = replace(
        CorrectionOptions(),
        tasks=tasks,
        updates=arguments.updates,
        learning_rate=arguments.learning_rate,
        jobs=arguments.jobs,
        moves=arguments.moves,
        lessons_per_judgement=arguments.lessons_per_judgement,
        seed=arguments.seed,
    )
    path = learn_from_planner(
        options,
        arguments.output,
        show,
        begin_with=arguments.begin_with,
        polish_px=arguments.polish_px,
    )
    policy = Policy.load(path)
    training = policy.manifest["training"]
    print(json.dumps(training | validate(policy, tasks, arguments.targets)))


def show(progress: LessonProgress) -> None:
    """Prints how far the training is."""
    gain = float(np.mean(progress.returns)) if progress.returns else math.nan
    print(
        f"{progress.updates:6} updates, loss {progress.loss:.3f}, regret "
        f"{progress.regret_px:.2f} px (ring score {progress.heuristic_regret_px:.2f}), "
        f"gain / area {gain:.4f}, validation {progress.validation_gain:.5f} (best "
        f"{progress.best_validation_gain:.5f}), {progress.elapsed_s:.0f} s",
        flush=True,
    )


if __name__ == "__main__":
    main()
