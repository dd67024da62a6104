"""Results on disk: written as they come, so that a killed comparison goes on where it stopped."""

import csv
import io
import json
import os
from collections.abc import Mapping
from dataclasses import astuple, fields
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO

from lasergym.comparison.work import ItemKey, Row
from lasergym.errors import LasergymError

__all__ = ["ResultStore", "ResultsError"]

_COLUMNS = tuple(field.name for field in fields(Row))


class ResultsError(LasergymError, ValueError):
    """Results on disk are damaged or belong to another comparison."""


class ResultStore:
    """The folder of a comparison: ``settings.json`` and one line of ``results.csv`` per item.

    The last column of ``results.csv`` holds the pulses as ``x y;x y;…``, px. Every line reaches
    the disk before the next item is waited for. A last line without its end, as a killed process
    leaves it, is dropped.
    """

    def __init__(self, folder: Path, settings: Mapping[str, Any]) -> None:
        """Opens a new or an unfinished comparison.

        Args:
            folder: Where the files are; made where missing.
            settings: All that decides the results, as JSON holds it.

        Raises:
            ResultsError: The folder holds results of other settings, or damaged ones.
        """
        self.rows: dict[ItemKey, Row] = {}
        folder.mkdir(parents=True, exist_ok=True)
        self._path = folder / "results.csv"
        _check_settings(folder / "settings.json", self._path, dict(settings))
        kept_bytes = self._read() if self._path.exists() else 0
        self._file: BinaryIO = self._path.open("ab")
        self._file.truncate(kept_bytes)
        if kept_bytes == 0:
            self._write(_COLUMNS)

    def append(self, row: Row) -> None:
        """Writes a result to the disk."""
        values = [repr(value) if isinstance(value, float) else value for value in astuple(row)]
        values[-1] = ";".join(f"{x_px!r} {y_px!r}" for x_px, y_px in row.xy_px)
        self._write(values)
        self.rows[row.key] = row

    def close(self) -> None:
        """Closes the file."""
        self._file.close()

    def __enter__(self) -> "ResultStore":
        """The open store."""
        return self

    def __exit__(
        self,
        _kind: type[BaseException] | None,
        _error: BaseException | None,
        _trace: TracebackType | None,
    ) -> None:
        """Closes the file."""
        self.close()

    def _read(self) -> int:
        """Reads the rows; returns the length of the file without a torn last line, bytes."""
        whole = self._path.read_bytes()
        kept = whole[: whole.rfind(b"\n") + 1]
        lines = csv.reader(io.StringIO(kept.decode("utf-8", errors="replace"), newline=""))
        header = next(lines, None)
        if header is not None and tuple(header) != _COLUMNS:
            raise ResultsError(f"{self._path} has other columns: give another folder with -o")
        for cells in lines:
            try:
                row = _parse(cells)
            except ValueError as error:
                raise ResultsError(
                    f"{self._path}, line {lines.line_num}, is damaged ({error}): delete the line, "
                    "and its item runs again"
                ) from error
            self.rows.setdefault(row.key, row)
        return len(kept)

    def _write(self, cells: Any) -> None:
        """One write of a whole line, flushed to the disk."""
        text = io.StringIO(newline="")
        csv.writer(text, lineterminator="\n").writerow(cells)
        self._file.write(text.getvalue().encode())
        self._file.flush()
        os.fsync(self._file.fileno())


def _check_settings(path: Path, results: Path, settings: dict[str, Any]) -> None:
    """Writes the settings of a new comparison, or compares those of an old one."""
    if not path.exists():
        if results.exists():
            raise ResultsError(f"{results} has no settings.json beside it: give another folder")
        scratch = path.with_suffix(".json.new")
        scratch.write_text(json.dumps(settings, indent=2) + "\n", encoding="utf-8")
        scratch.replace(path)
        return
    try:
        before = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ResultsError(f"{path} is no JSON ({error}): give another folder") from error
    now = json.loads(json.dumps(settings))
    if not isinstance(before, dict):
        raise ResultsError(f"{path} holds no settings: give another folder")
    differences = [
        f"{name} was {json.dumps(before.get(name))} and is {json.dumps(now.get(name))}"
        for name in {**before, **now}
        if before.get(name) != now.get(name)
    ]
    if differences:
        raise ResultsError(
            f"{path.parent} holds a comparison with other settings: {'; '.join(differences)}. "
            "Repeat them to go on, or give another folder with -o"
        )


def _parse(cells: list[str]) -> Row:
    if len(cells) != len(_COLUMNS):
        raise ValueError(f"{len(cells)} columns instead of {len(_COLUMNS)}")
    task, target, planner, seed, area_px, max_pulses, pulses = cells[:7]
    machined, off_target, reward, elapsed_s = (float(cell) for cell in cells[7:11])
    xy_px = []
    for pair in filter(None, cells[11].split(";")):
        x_px, y_px = pair.split(" ")
        xy_px.append((float(x_px), float(y_px)))
    if len(xy_px) != int(pulses) or int(area_px) < 1:
        raise ValueError("its figures contradict each other")
    return Row(
        task,
        target,
        planner,
        int(seed),
        int(area_px),
        int(max_pulses),
        int(pulses),
        machined,
        off_target,
        reward,
        elapsed_s,
        tuple(xy_px),
    )
