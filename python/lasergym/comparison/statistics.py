"""Means, spreads and paired wins of planners over targets."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations

from lasergym.comparison.tasks import (
    AREA_CLASSES_PX,
    RANDOM_SHAPES,
    area_class_px,
    class_title,
)
from lasergym.comparison.work import Row

__all__ = ["MEASURES", "Group", "Measure", "PairedWins", "Summary", "group_rows", "summarise"]

_SAME_REWARD = 1e-9
"""Rewards are multiples of 10⁻⁴; what differs by less than this is the same."""


@dataclass(frozen=True)
class Measure:
    """A row of Table 1.

    Attributes:
        name: The name in JSON and CSV.
        title: The name in Markdown and on the terminal.
        value: The figure of one target.
        decimals: Decimals in print; None prints three significant digits.
    """

    name: str
    title: str
    value: Callable[[Row], float]
    decimals: int | None


MEASURES: tuple[Measure, ...] = (
    Measure("machined_percent", "target machined %", lambda row: 100 * row.machined_fraction, 2),
    Measure(
        "off_target_percent",
        "off-target machined %",
        lambda row: 100 * row.off_target_fraction,
        2,
    ),
    Measure("pulses", "pulses", lambda row: row.pulses, 1),
    Measure("reward", "total reward", lambda row: row.reward, 4),
    Measure("reward_per_area", "reward · 10⁴ / area", lambda row: row.reward_per_area, 4),
    Measure("elapsed_s", "seconds per target", lambda row: row.elapsed_s, None),
)
"""The rows of Table 1; percentages are of the target's area."""


@dataclass(frozen=True)
class Summary:
    """A figure over several targets.

    Attributes:
        mean: Mean.
        spread: Standard deviation of the sample (n − 1); None for a single target.
        targets: Number of targets.
    """

    mean: float
    spread: float | None
    targets: int


@dataclass(frozen=True)
class PairedWins:
    """Two planners target by target.

    Attributes:
        planner: Name of the one.
        other: Name of the other.
        targets: Number of targets that both have done.
        at_least: Targets on which the reward of ``planner`` is at least that of ``other``.
        better: Targets on which it is higher.
        difference: Reward · 10⁴ / area of ``planner`` less that of ``other``, over the targets.
    """

    planner: str
    other: str
    targets: int
    at_least: int
    better: int
    difference: Summary

    @property
    def standard_error(self) -> float | None:
        """Standard error of the mean difference; None for a single target."""
        if self.difference.spread is None:
            return None
        return self.difference.spread / math.sqrt(self.targets)


@dataclass(frozen=True)
class Group:
    """Targets that are summed up together: a task or an area class of it.

    Attributes:
        name: Task, with the area class where it is one.
        whole_task: Whether these are all targets of a task.
        targets: Number of targets.
        figures: A summary by planner and name of the measure.
        wins: All ordered pairs of planners, in the order of the columns.
    """

    name: str
    whole_task: bool
    targets: int
    figures: Mapping[str, Mapping[str, Summary]]
    wins: tuple[PairedWins, ...]


def summarise(values: Sequence[float]) -> Summary:
    """Mean and standard deviation of at least one figure."""
    mean = math.fsum(values) / len(values)
    if len(values) == 1:
        return Summary(mean, None, 1)
    variance = math.fsum((value - mean) ** 2 for value in values) / (len(values) - 1)
    return Summary(mean, math.sqrt(variance), len(values))


def group_rows(rows: Iterable[Row], planners: Sequence[str]) -> tuple[Group, ...]:
    """Sums up results task by task, random shapes also by area class.

    Args:
        rows: Results in any order.
        planners: Columns; rows of other planners are left out.

    Returns:
        The groups: tasks by the order of their first row, each followed by its area classes.
    """
    by_task: dict[str, list[Row]] = {}
    for row in rows:
        if row.planner in planners:
            by_task.setdefault(row.task, []).append(row)
    groups = []
    for task, members in by_task.items():
        groups.append(_group(task, members, planners, whole_task=True))
        if task != RANDOM_SHAPES:
            continue
        for bounds_px in AREA_CLASSES_PX:
            inside = [row for row in members if area_class_px(row.area_px) == bounds_px]
            if inside:
                name = f"{task}, {class_title(bounds_px)}"
                groups.append(_group(name, inside, planners, whole_task=False))
    return tuple(groups)


def _group(name: str, rows: Sequence[Row], planners: Sequence[str], *, whole_task: bool) -> Group:
    by_planner: dict[str, dict[str, Row]] = {planner: {} for planner in planners}
    for row in rows:
        by_planner[row.planner][row.target] = row
    present = {planner: done for planner, done in by_planner.items() if done}
    figures = {
        planner: {
            measure.name: summarise([measure.value(row) for row in done.values()])
            for measure in MEASURES
        }
        for planner, done in present.items()
    }
    wins = [_wins(present, *pair) for pair in permutations(present, 2)]
    return Group(
        name,
        whole_task,
        len({row.target for row in rows}),
        figures,
        tuple(pair for pair in wins if pair is not None),
    )


def _wins(rows: Mapping[str, Mapping[str, Row]], planner: str, other: str) -> PairedWins | None:
    """Two planners on the targets that both have done; None where there is none."""
    pairs = [(row, rows[other][name]) for name, row in rows[planner].items() if name in rows[other]]
    if not pairs:
        return None
    return PairedWins(
        planner,
        other,
        len(pairs),
        sum(one.reward >= two.reward - _SAME_REWARD for one, two in pairs),
        sum(one.reward > two.reward + _SAME_REWARD for one, two in pairs),
        summarise([one.reward_per_area - two.reward_per_area for one, two in pairs]),
    )
