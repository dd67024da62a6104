"""Where the program prints: data on stdout, notes, errors and progress on stderr."""

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

__all__ = [
    "Bar",
    "note",
    "print_data",
    "print_json",
    "progress_bar",
    "report_error",
    "rounded_time",
    "table",
]


def print_data(data: Table | str) -> None:
    """Prints a table or text on stdout, within the width of the terminal."""
    Console(highlight=False, markup=False).print(data, soft_wrap=isinstance(data, str))


def print_json(report: dict[str, Any]) -> None:
    """Prints one JSON object on stdout."""
    sys.stdout.write(json.dumps(report, indent=2) + "\n")


def note(text: str) -> None:
    """Prints one line on stderr."""
    Console(stderr=True, highlight=False, markup=False).print(text, soft_wrap=True)


def report_error(message: str, hint: str | None) -> None:
    """Prints ``error: …`` and, where there is one, ``hint: …`` on stderr, one line each."""
    console = Console(stderr=True, highlight=False)
    for label, style, text in (("error", "bold red", message), ("hint", "bold cyan", hint)):
        if text:
            line = Text.assemble((f"{label}:", style), " ", " ".join(text.split()))
            console.print(line, soft_wrap=True)


def table(*columns: str, texts: int = 1) -> Table:
    """A table without frame; the first ``texts`` columns are text, the others figures."""
    made = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold")
    for index, column in enumerate(columns):
        made.add_column(column, justify="left" if index < texts else "right", overflow="fold")
    return made


class Bar:
    """How far some work is."""

    def __init__(self, progress: Progress, description: str) -> None:
        """Begins at nothing done."""
        self._progress = progress
        self._task = progress.add_task(description, total=1.0)

    def show(self, fraction: float, description: str | None = None) -> None:
        """Shows the fraction done, in [0, 1], and what is being done."""
        self._progress.update(self._task, completed=fraction, description=description)


@contextmanager
def progress_bar(description: str) -> Iterator[Bar]:
    """A progress bar on stderr, which shows only on a terminal and goes when the work is done."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(20), TaskProgressColumn())
    with Progress(
        *columns,
        TimeElapsedColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    ) as progress:
        yield Bar(progress, description)


def rounded_time(time_s: float) -> str:
    """A time that is left, in words: seconds, minutes or hours."""
    if time_s < 90:
        return f"{time_s:.0f} s"
    if time_s < 5400:
        return f"{time_s / 60:.0f} min"
    return f"{time_s / 3600:.1f} h"
