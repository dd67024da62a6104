"""Table 1 in Markdown, CSV and JSON."""

import csv
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from lasergym.comparison.columns import column_of
from lasergym.comparison.statistics import MEASURES, Group, Measure, PairedWins, Summary
from lasergym.comparison.tasks import MILLING

__all__ = ["ResultTable", "WinMatrix"]

_REMARKS = (
    "Mean ± standard deviation over the targets. Percentages are of the target's area; reward is "
    "(target − off-target machined) / workpiece area.",
    "Seconds are the time of one planner on one thread, while as many others ran beside it as the "
    "run had workers.",
    "Raster scans use as many pulses as their grid has cells, whatever the budget.",
)

_MILLING_REMARK = (
    "Of depth maps (milling), percentages are of the target's volume, and the reward is the fall "
    "of the tracking error: what is removed above the target less what is removed below it."
)

_PUBLISHED = {
    "star": ("96.85 / 97.55", "1.72 / 1.93", "40 / 45", "0.462 / 0.465"),
    "rotated-star": (
        "97.01 ± 0.54 / 97.44 ± 0.39",
        "3.60 ± 0.80 / 1.92 ± 0.22",
        "–",
        "0.442 ± 0.005 / 0.452 ± 0.002",
    ),
}
"""Xie et al. (2022), Table 1, rows a and b: RL / CMA-ES."""


@dataclass(frozen=True)
class WinMatrix:
    """Who is at least as good as whom, target by target.

    Attributes:
        task: Name of the task.
        planners: Rows and columns.
        cells: (row, column) → the row's planner against the column's.
    """

    task: str
    planners: tuple[str, ...]
    cells: Mapping[tuple[str, str], PairedWins]

    def rows(self) -> Iterator[tuple[str, ...]]:
        """Title of the row's planner, then ``wins/targets`` for each column."""
        for planner in self.planners:
            pairs = [self.cells.get((planner, other)) for other in self.planners]
            yield (
                column_of(planner).title,
                *("" if pair is None else f"{pair.at_least}/{pair.targets}" for pair in pairs),
            )

    def differences(self) -> Iterator[tuple[str, ...]]:
        """Title of the row's planner, then mean difference ± standard error for each column."""
        for planner in self.planners:
            pairs = [self.cells.get((planner, other)) for other in self.planners]
            yield (
                column_of(planner).title,
                *("" if pair is None else _difference(pair) for pair in pairs),
            )


@dataclass(frozen=True)
class ResultTable:
    """The planners of a comparison side by side.

    Attributes:
        planners: Columns.
        groups: Tasks and area classes.
        settings: What decided the results.
    """

    planners: tuple[str, ...]
    groups: tuple[Group, ...]
    settings: Mapping[str, Any]

    def titles(self) -> tuple[str, ...]:
        """The heads of the planners' columns."""
        return tuple(column_of(planner).title for planner in self.planners)

    def rows_of(self, group: Group) -> Iterator[tuple[str, ...]]:
        """Title of the measure, then a cell for each planner."""
        for measure in MEASURES:
            figures = [group.figures.get(planner) for planner in self.planners]
            yield (
                measure.title,
                *(
                    "–" if found is None else _cell(measure, found[measure.name])
                    for found in figures
                ),
            )

    def matrices(self) -> Iterator[WinMatrix]:
        """Paired wins of each task that two planners have done."""
        for group in self.groups:
            if group.whole_task and group.wins:
                cells = {(pair.planner, pair.other): pair for pair in group.wins}
                yield WinMatrix(group.name, self.planners, cells)

    def as_dict(self) -> dict[str, Any]:
        """The table as JSON holds it."""
        return {
            "settings": dict(self.settings),
            "groups": [
                {
                    "name": group.name,
                    "whole_task": group.whole_task,
                    "targets": group.targets,
                    "planners": {
                        planner: {
                            name: {"mean": summary.mean, "spread": summary.spread}
                            for name, summary in figures.items()
                        }
                        for planner, figures in group.figures.items()
                    },
                    "paired_wins": [
                        {
                            "planner": pair.planner,
                            "other": pair.other,
                            "targets": pair.targets,
                            "at_least": pair.at_least,
                            "better": pair.better,
                            "mean_difference": pair.difference.mean,
                            "standard_error": pair.standard_error,
                        }
                        for pair in group.wins
                    ],
                }
                for group in self.groups
            ],
        }

    def csv(self) -> str:
        """One line for each group, measure and planner."""
        text = io.StringIO(newline="")
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(("group", "planner", "measure", "targets", "mean", "spread"))
        for group in self.groups:
            for planner, figures in group.figures.items():
                for name, summary in figures.items():
                    spread = "" if summary.spread is None else repr(summary.spread)
                    cells = (group.name, planner, name, summary.targets, repr(summary.mean), spread)
                    writer.writerow(cells)
        return text.getvalue()

    def markdown(self) -> str:
        """The table with paired wins, published figures and settings."""
        lines = ["# Planners side by side", ""]
        for group in self.groups:
            heading = "##" if group.whole_task else "###"
            lines += [f"{heading} {group.name} ({_targets(group.targets)})", ""]
            published = _PUBLISHED.get(group.name)
            if published is None:
                lines += _markdown_table(("", *self.titles()), self.rows_of(group))
                continue
            columns = (*self.titles(), "RL / CMA-ES of Xie et al. (2022)")
            lines += _markdown_table(
                ("", *columns),
                (
                    (*cells, published[index] if index < len(published) else "–")
                    for index, cells in enumerate(self.rows_of(group))
                ),
            )
        lines += self._markdown_wins()
        milled = any(group.name == MILLING for group in self.groups)
        remarks = (*_REMARKS, _MILLING_REMARK) if milled else _REMARKS
        lines += ["## Remarks", "", *(f"- {remark}" for remark in remarks), ""]
        lines += ["## Settings", ""]
        lines += [f"- {name}: {_setting(value)}" for name, value in self.settings.items()]
        return "\n".join(lines) + "\n"

    def _markdown_wins(self) -> list[str]:
        lines = []
        for matrix in self.matrices():
            header = ("", *self.titles())
            lines += [
                f"## Target by target: {matrix.task}",
                "",
                "Targets on which the row's planner earns at least the reward of the column's:",
                "",
                *_markdown_table(header, matrix.rows()),
                "Mean difference, row less column, of reward · 10⁴ / area ± standard error:",
                "",
                *_markdown_table(header, matrix.differences()),
            ]
        return lines


def _cell(measure: Measure, summary: Summary) -> str:
    if measure.decimals is None:
        mean = _significant(summary.mean)
        return mean if summary.spread is None else f"{mean} ± {_significant(summary.spread, 2)}"
    mean = f"{summary.mean:.{measure.decimals}f}"
    if summary.spread is None:
        return mean
    return f"{mean} ± {summary.spread:.{measure.decimals}f}"


def _significant(figure: float, digits: int = 3) -> str:
    """Rounded to significant digits, without an exponent."""
    if figure <= 0:
        return "0"
    decimals = digits - 1 - math.floor(math.log10(figure))
    return f"{figure:.{min(max(decimals, 0), 7)}f}"


def _difference(pair: PairedWins) -> str:
    mean = f"{pair.difference.mean:+.4f}".replace("-", "−")
    error = pair.standard_error
    return mean if error is None else f"{mean} ± {error:.4f}"


def _targets(number: int) -> str:
    return "1 target" if number == 1 else f"{number} targets"


def _setting(value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(str(entry) for entry in value) or "none"
    if isinstance(value, dict):
        return "; ".join(f"{name} {_setting(entry)}" for name, entry in value.items())
    return str(value)


def _markdown_table(header: Sequence[str], rows: Iterator[tuple[str, ...]]) -> list[str]:
    marks = ("---", *["---:"] * (len(header) - 1))
    return [*(f"| {' | '.join(cells)} |" for cells in (header, marks, *rows)), ""]
