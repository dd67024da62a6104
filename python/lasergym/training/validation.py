"""Targets that judge learning from the planner; no lesson is drawn from their seeds."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lasergym import planners, targets
from lasergym.comparison import PulseBudget
from lasergym.policy import Policy
from lasergym.targets import Target
from lasergym.training.teacher import FIRST_VALIDATION_SEED, TeacherTask

__all__ = ["mean_gain", "validation_targets"]

_STAR_PULSES = range(40, 46)

_AREA_BUDGET = PulseBudget(pulses=None, area_per_pulse_px=125.0)


def validation_targets(task: TeacherTask, count: int) -> Iterator[tuple[Target, int]]:
    """Targets of a task with their pulse budgets.

    Args:
        task: The upright star comes six times, with 40 to 45 pulses; stars at ``count`` angles
            from 0.5° on, with 40 to 45 pulses in turn; random shapes of the
            seeds from :data:`FIRST_VALIDATION_SEED` on, with area / 125 pulses.
        count: How many, at least 1; of no meaning for the upright star.

    Yields:
        Bitmap and pulse budget.
    """
    if task is TeacherTask.STAR:
        for pulses in _STAR_PULSES:
            yield targets.star(), pulses
        return
    for index in range(count):
        if task is TeacherTask.ROTATED_STAR:
            angle_deg = index * 360.0 / count + 0.5
            yield targets.star(angle_deg), _STAR_PULSES[index % len(_STAR_PULSES)]
        else:
            target = targets.random_shape(seed=FIRST_VALIDATION_SEED + index)
            yield target, _AREA_BUDGET.pulses_for(int(target.sum()))


def mean_gain(policy: Policy, task: TeacherTask, count: int) -> float:
    """Mean of (hits − misses) / area of a policy on the validation targets of a task."""
    gains = []
    for target, pulses in validation_targets(task, count):
        plan = planners.plan(target, "policy", policy=policy, max_pulses=pulses)
        gains.append(plan.reward * target.size / int(target.sum()))
    return float(np.mean(gains))
