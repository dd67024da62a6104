"""Learning from the planner in a folder of its own; it goes on after a kill."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import numpy as np

from lasergym.export import network_bytes, write_network
from lasergym.policy import Policy
from lasergym.sb3 import CorrectionNet
from lasergym.training.correction_options import CorrectionOptions, LessonProgress
from lasergym.training.corrections import CorrectionLearner
from lasergym.training.spatial_decision import POLISH_PX
from lasergym.training.tables import to_table
from lasergym.training.validation import mean_gain

__all__ = ["learn_from_planner"]

_NOT_IN_HISTORY = {"total_updates", "remaining_s"}


def learn_from_planner(
    options: CorrectionOptions,
    folder: Path,
    progress: Callable[[LessonProgress], None],
    *,
    begin_with: Path | None = None,
    polish_px: float = POLISH_PX,
) -> Path:
    """Trains the network of a spatial policy on what the annealing planner says.

    The folder gets ``checkpoint.pt``, ``history.csv`` and at the end ``policy.safetensors``, which
    holds the network that did best on the validation targets. Called again with the same options,
    the training goes on from its checkpoint, or ends at once.

    Args:
        options: The settings; only ``updates`` may differ from those of the checkpoint.
        folder: Made where missing.
        progress: Told after every judgement, when the checkpoint has been written.
        begin_with: Policy file whose weights a new training begins with; None begins anew.
        polish_px: Range of the polish of the policy that is written, px, in [0, 2].

    Returns:
        The policy file, whose metadata has options, counts and time.

    Raises:
        CheckpointError: The checkpoint or ``begin_with`` cannot be read or does not fit.
        OptionError: A setting is out of range.
    """
    learner = CorrectionLearner(options)
    folder.mkdir(parents=True, exist_ok=True)
    checkpoint = folder / "checkpoint.pt"
    if checkpoint.exists():
        learner.load(checkpoint)
    elif begin_with is not None:
        learner.begin_with(begin_with)

    def report(now: LessonProgress) -> None:
        _append(folder / "history.csv", now)
        progress(now)

    def judge(network: CorrectionNet) -> float:
        content = network_bytes(network.exported(polish_px=polish_px), storage="bfloat16")
        policy = Policy.from_bytes(content)
        gains = [mean_gain(policy, task, options.validation_targets) for task in options.tasks]
        return float(np.mean(gains))

    learner.learn(judge, report, checkpoint)
    training = {
        "options": to_table(options),
        "begun_with": None if begin_with is None else begin_with.name,
        "updates": learner.updates,
        "samples": learner.samples,
        "elapsed_s": round(learner.elapsed_s),
        "validation_gain": round(learner.best_gain, 5),
    }
    path = folder / "policy.safetensors"
    network = learner.best.exported(polish_px=polish_px)
    write_network(network, path, storage="bfloat16", training=training)
    return path


def _append(history: Path, progress: LessonProgress) -> None:
    """Adds a line to the history; ``returns`` are written as their mean."""
    row = {name: one for name, one in asdict(progress).items() if name not in _NOT_IN_HISTORY}
    row["returns"] = float(np.mean(progress.returns)) if progress.returns else float("nan")
    fresh = not history.exists()
    with history.open("a", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(row))
        if fresh:
            writer.writeheader()
        writer.writerow(row)
