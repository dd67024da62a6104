"""Targets that judge an agent while it trains; where there is a choice, it never trains on them."""

from __future__ import annotations

from lasergym import targets
from lasergym.comparison.tasks import FIRST_HELD_OUT_SEED, TaskTarget
from lasergym.targets import Target
from lasergym.training.config import TrainingConfig

__all__ = ["held_out_targets"]


def held_out_targets(config: TrainingConfig) -> tuple[TaskTarget, ...]:
    """The targets of a task, with its pulse budget.

    The star and a pattern are the one target of their task. Angles of the rotated star are spread
    evenly. Random shapes have the first held-out seeds.
    """
    task, count = config.task, config.evaluation.targets
    made: list[tuple[str, Target]]
    if task.env_id == "lasergym/RotatedStar-v0":
        angles_deg = [index * 360 / count for index in range(count)]
        made = [(f"star:{angle_deg:g}", targets.star(angle_deg)) for angle_deg in angles_deg]
    elif task.env_id == "lasergym/RandomShape-v0":
        seeds = range(FIRST_HELD_OUT_SEED, FIRST_HELD_OUT_SEED + count)
        made = [(f"random-shape:{seed}", targets.random_shape(seed)) for seed in seeds]
    elif task.target is not None:
        made = [(task.target, targets.load(task.target))]
    else:
        made = [("star", targets.star())]
    return tuple(TaskTarget(task.env_id, name, target, task.max_pulses) for name, target in made)
