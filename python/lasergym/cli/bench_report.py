"""The figures of a benchmark as tables, Markdown and JSON."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

from rich.table import Table

from lasergym.cli.memory import MemoryUse
from lasergym.cli.output import table
from lasergym.cli.throughput import Throughput

__all__ = ["BenchReport"]

_HEADER = ("envs", "contestant", "threads", "steps/s", "ns/step", "ratio")

_STATE_BYTES = 19 * 2 * 16
"""A pulse of 9 px meets at most 19 rows of two bitmaps (remaining, forbidden) of 16 bytes a row."""


@dataclass(frozen=True)
class BenchReport:
    """What ``lasergym bench`` has measured.

    Attributes:
        machine: Processor, cores, load and versions.
        rows: Throughput of every contestant; the reference comes first in its group.
        changed_px: Observation pixels that a random pulse changes, by task.
        shape_us: Time for one kept random shape, µs.
        memory: Memory of many environments, where measured.
    """

    machine: dict[str, str | int | float]
    rows: tuple[Throughput, ...]
    changed_px: dict[str, float]
    shape_us: float
    memory: MemoryUse | None

    def as_dict(self) -> dict[str, Any]:
        """The report as JSON holds it; ``ratio`` is lasergym on one thread over the contestant."""
        return {
            "machine": self.machine,
            "throughput": [
                {**asdict(row), "step_ns": row.step_ns, "ratio": self._ratio(row)}
                for row in self.rows
            ],
            "bytes_per_step": {
                task: {"state": _STATE_BYTES, "observation": changed}
                for task, changed in self.changed_px.items()
            },
            "random_shape_us": self.shape_us,
            "memory": None if self.memory is None else asdict(self.memory),
        }

    def parts(self) -> Iterator[Table | str]:
        """Tables and lines for a terminal."""
        for task in self.changed_px:
            made = table(*_HEADER, texts=2)
            made.title = task
            made.title_justify = "left"
            for row in self._rows_of(task):
                made.add_row(*row)
            yield made
            yield ""
        yield from self._remarks()

    def markdown(self) -> str:
        """The whole report as Markdown."""
        header = ("task", *_HEADER)
        lines = [_markdown_row(header), _markdown_row(("---", *["---:"] * len(_HEADER)))]
        for task in self.changed_px:
            lines += [_markdown_row((task, *row)) for row in self._rows_of(task)]
        lines.append("")
        lines += [f"- {remark}" for remark in self._remarks()]
        return "\n".join(lines) + "\n"

    def _rows_of(self, task: str) -> Iterator[tuple[str, ...]]:
        for row in self.rows:
            if row.task == task:
                yield (
                    str(row.num_envs),
                    row.contestant,
                    str(row.threads),
                    _rounded(row.steps_per_s),
                    _rounded(row.step_ns),
                    f"{self._ratio(row):.3g}",
                )

    def _remarks(self) -> Iterator[str]:
        yield "ratio: how many times faster lasergym on one thread (copy=False) is"
        for task, changed in self.changed_px.items():
            yield (
                f"{task}: a step must touch {_STATE_BYTES} bytes of state and "
                f"{changed:.0f} bytes of observation"
            )
        yield f"a kept random shape takes {self.shape_us:.1f} µs"
        if self.memory is not None:
            yield (
                f"{self.memory.num_envs} environments: {self.memory.peak_mb:.0f} MB resident at "
                f"most, of which {self.memory.imports_mb:.0f} MB before they are made"
            )
        yield ", ".join(f"{name} {value}" for name, value in self.machine.items())

    def _ratio(self, row: Throughput) -> float:
        for other in self.rows:
            same = other.task == row.task and other.num_envs == row.num_envs
            if same and other.contestant == "lasergym" and other.threads == 1:
                return other.steps_per_s / row.steps_per_s
        return float("nan")


def _rounded(figure: float) -> str:
    """Three significant digits, thousands set apart."""
    return f"{float(f'{figure:.3g}'):,.0f}" if figure >= 100 else f"{figure:.3g}"


def _markdown_row(cells: tuple[str, ...]) -> str:
    return f"| {' | '.join(cells)} |"
