"""A work item: one planner on one target. It carries all it needs, so any process can do it."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from hashlib import blake2b
from typing import Any, TypeAlias, cast

import numpy as np

from lasergym import milling, planners
from lasergym.comparison.columns import column_of, planners_of
from lasergym.comparison.options import CompareOptions, Effort
from lasergym.comparison.tasks import MILLING, TaskTarget
from lasergym.errors import LasergymError, PlanError
from lasergym.planners import PlannerName
from lasergym.policy import Policy
from lasergym.targets import SIZE_PX

__all__ = ["PULSE_RADIUS_PX", "ItemKey", "Row", "WorkItem", "derive_seed", "run_item", "work_items"]

PULSE_RADIUS_PX = 9.0
"""Radius of every pulse of a comparison, px."""

ItemKey: TypeAlias = tuple[str, str, str]
"""What names an item: task, target and planner."""

_WORKPIECE_PX = SIZE_PX * SIZE_PX
_UNTIMED_S = 0.02
_ITERATION_S = {"anneal": 5e-7, "cma-es": 5e-5}


@dataclass(frozen=True)
class WorkItem:
    """One planner on one target.

    Attributes:
        task: Name of the task.
        target: Name of the target.
        planner: Name of the planner.
        seed: Seed of the planner, whether it takes one or not.
        max_pulses: Most pulses that may be used.
        effort: How long the planner works.
        bits: The target, see :attr:`TaskTarget.bits`.
        policy: Content of the policy file, for ``"policy"`` and ``"agent-mpc"``.
        process: Profile that mills, for the task ``"milling"``.
    """

    task: str
    target: str
    planner: str
    seed: int
    max_pulses: int
    effort: Effort
    bits: bytes
    policy: bytes | None = None
    process: str | None = None

    @property
    def key(self) -> ItemKey:
        """What names the item."""
        return self.task, self.target, self.planner

    @property
    def expected_s(self) -> float:
        """A guess of the time that the item takes, s."""
        if self.effort.iterations is not None:
            return _ITERATION_S[self.planner] * self.effort.iterations
        return self.effort.budget_s or _UNTIMED_S


@dataclass(frozen=True)
class Row:
    """What a planner achieves on a target.

    Attributes:
        task: Name of the task.
        target: Name of the target.
        planner: Name of the planner.
        seed: Seed of the planner, whether it takes one or not.
        area_px: Area of the target, px.
        max_pulses: Pulses that were allowed.
        pulses: Pulses that were used.
        machined_fraction: Machined fraction of the target, in [0, 1].
        off_target_fraction: Area machined beside the target over the area of the target.
        reward: (target machined − off-target machined) / workpiece area.
        elapsed_s: Time that planning took, s.
        xy_px: Centres of the pulses in firing order, px; (x, y) each.
    """

    task: str
    target: str
    planner: str
    seed: int
    area_px: int
    max_pulses: int
    pulses: int
    machined_fraction: float
    off_target_fraction: float
    reward: float
    elapsed_s: float
    xy_px: tuple[tuple[float, float], ...]

    @property
    def key(self) -> ItemKey:
        """What names the item that the row is the result of."""
        return self.task, self.target, self.planner

    @property
    def reward_per_area(self) -> float:
        """Reward · 10⁴ / area: 1 is a target machined whole with nothing beside it."""
        return self.reward * _WORKPIECE_PX / self.area_px


def work_items(options: CompareOptions, made: TaskTarget) -> Iterator[WorkItem]:
    """The items of one target, a planner each."""
    policy = options.policy_file(made.task)
    process = options.process if made.task == MILLING else None
    for planner in (one for one in options.planners if one in planners_of(made.task)):
        yield WorkItem(
            made.task,
            made.name,
            planner,
            derive_seed(options.seed, made.task, made.name, planner),
            made.max_pulses,
            options.effort(planner),
            made.bits,
            policy if planner in planners.LEARNED_PLANNERS else None,
            process,
        )


@lru_cache(maxsize=4)
def _policy(content: bytes) -> Policy:
    return Policy.from_bytes(content)


def derive_seed(seed: int, task: str, target: str, planner: str) -> int:
    """The seed of an item, from 0 to 2⁴⁸ − 1: BLAKE2b of the comparison's seed and its names."""
    text = "\0".join((str(seed), task, target, planner))
    return int.from_bytes(blake2b(text.encode(), digest_size=6).digest(), "big")


def run_item(item: WorkItem, stop: Callable[[], bool] | None = None) -> Row | None:
    """Plans one item.

    Args:
        item: The item.
        stop: Asked now and then whether to give up.

    Returns:
        The result; None where the planner was stopped before it had finished.

    Raises:
        PlanError: The planner refuses the target or its settings.
    """
    if item.process is not None:
        return _mill(item, item.process, stop)
    column = column_of(item.planner)
    settings: dict[str, Any] = {"max_pulses": item.max_pulses, "pulse_radius_px": PULSE_RADIUS_PX}
    if column.seeded:
        settings["seed"] = item.seed
    if column.timed:
        settings["budget_s"] = item.effort.budget_s
        settings["iterations"] = item.effort.iterations
    if item.policy is not None:
        settings["policy"] = _policy(item.policy)
    if stop is not None:
        settings["progress"] = lambda _fraction, _reward: stop()
    target = np.unpackbits(np.frombuffer(item.bits, np.uint8)).reshape(SIZE_PX, SIZE_PX) > 0
    try:
        plan = planners.plan(target, cast("PlannerName", item.planner), **settings)
    except LasergymError as error:
        raise PlanError(f"{item.planner} on {item.target} ({item.task}): {error}") from error
    if plan.partial:
        return None
    return Row(
        item.task,
        item.target,
        item.planner,
        item.seed,
        int(target.sum()),
        item.max_pulses,
        plan.pulses,
        plan.machined_fraction,
        plan.off_target_fraction,
        plan.reward,
        plan.elapsed_s,
        tuple((x_px, y_px) for x_px, y_px in plan.xy_px.tolist()),
    )


def _mill(item: WorkItem, process: str, stop: Callable[[], bool] | None) -> Row | None:
    """As :func:`run_item`, for a depth map."""
    target_um = np.frombuffer(item.bits, np.float64).reshape(SIZE_PX, SIZE_PX)
    try:
        plan = milling.plan_spots(
            target_um,
            cast("milling.SpotPlannerName", item.planner),
            progress=None if stop is None else lambda _fraction: stop(),
            process=process,
            max_spots=item.max_pulses,
            tolerance_percent=0.0,
        )
    except LasergymError as error:
        raise PlanError(f"{item.planner} on {item.target} ({item.task}): {error}") from error
    if plan.partial:
        return None
    xy_px = plan.xy_um * (SIZE_PX / plan.side_um)
    return Row(
        item.task,
        item.target,
        item.planner,
        item.seed,
        target_um.size,
        item.max_pulses,
        plan.spots,
        plan.machined_fraction,
        plan.off_target_fraction,
        plan.reward,
        plan.elapsed_s,
        tuple((x_px, y_px) for x_px, y_px in xy_px.tolist()),
    )
