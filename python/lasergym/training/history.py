"""What a run records as it goes: one line of CSV for each update and each evaluation."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Generic, TypeVar

from lasergym.errors import LasergymError

__all__ = ["Evaluated", "HistoryError", "Log", "Updated"]


class HistoryError(LasergymError, ValueError):
    """The history of a run is damaged."""


@dataclass(frozen=True)
class Updated:
    """A line of ``history.csv``: the agent as it acts in training, between two updates.

    Attributes:
        steps: Pulses so far.
        training_s: Time of training so far, s.
        episodes: Episodes that have ended since the line before.
        return_mean: Their mean return; nan where none has ended.
        return_spread: Standard deviation of their return; nan where none has ended.
        pulses_mean: Their mean number of pulses; nan where none has ended.
        steps_per_s: Pulses per second since the line before.
        environment_fraction: Share of that time in the environments, in [0, 1].
    """

    steps: int
    training_s: float
    episodes: int
    return_mean: float
    return_spread: float
    pulses_mean: float
    steps_per_s: float
    environment_fraction: float


@dataclass(frozen=True)
class Evaluated:
    """A line of ``evaluations.csv``: the agent without exploration on held-out targets.

    Attributes:
        steps: Pulses trained with.
        training_s: Time of training so far, s.
        targets: Number of targets.
        return_mean: Mean return.
        return_spread: Standard deviation of the sample; nan for a single target.
        machined_percent: Mean machined part of the target.
        off_target_percent: Mean area machined beside the target over the area of the target.
        pulses: Mean number of pulses.
        well_machined_percent: Share of the targets of which more than 90 % are machined.
    """

    steps: int
    training_s: float
    targets: int
    return_mean: float
    return_spread: float
    machined_percent: float
    off_target_percent: float
    pulses: float
    well_machined_percent: float


Line = TypeVar("Line", Updated, Evaluated)


class Log(Generic[Line]):
    """A CSV file of lines that are kept in memory too; each is flushed as it comes."""

    def __init__(self, path: Path, kind: type[Line], until_steps: int | None = None) -> None:
        """Opens a new log, or goes on with one.

        Args:
            path: The file.
            kind: Class of the lines.
            until_steps: Keeps the lines up to these steps; None begins an empty log.

        Raises:
            HistoryError: The file is damaged before these steps.
        """
        self.path = path
        self.lines: list[Line] = []
        self._columns = [field.name for field in fields(kind)]
        if until_steps is not None and path.exists():
            self.lines = [line for line in _read(path, kind) if line.steps <= until_steps]
        text = _csv([self._columns, *(list(asdict(line).values()) for line in self.lines)])
        path.write_text(text, encoding="utf-8")

    def append(self, line: Line) -> None:
        """Writes a line."""
        self.lines.append(line)
        with self.path.open("a", encoding="utf-8", newline="") as file:
            file.write(_csv([list(asdict(line).values())]))


def _read(path: Path, kind: type[Line]) -> list[Line]:
    """The whole lines of a file; a last one without its end is left out."""
    text = path.read_text(encoding="utf-8")
    whole = text[: text.rfind("\n") + 1]
    cells_of_lines = enumerate(csv.DictReader(io.StringIO(whole)), 2)
    return [_line(kind, cells, f"{path}, line {number},") for number, cells in cells_of_lines]


def _line(kind: type[Line], cells: Mapping[str, str], where: str) -> Line:
    types = {"int": int, "float": float}
    try:
        return kind(
            **{field.name: types[str(field.type)](cells[field.name]) for field in fields(kind)}
        )
    except (TypeError, ValueError, KeyError) as error:
        raise HistoryError(f"{where} is damaged: {error}") from error


def _csv(lines: list[list[Any]]) -> str:
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator="\n").writerows(lines)
    return text.getvalue()
