"""A whole comparison: targets, work, results on disk, table and pictures."""

import hashlib
import os
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import lasergym
from lasergym.comparison import figures, trajectories
from lasergym.comparison.columns import column_of
from lasergym.comparison.farm import run_local, run_on_ray
from lasergym.comparison.options import CompareOptions
from lasergym.comparison.statistics import group_rows
from lasergym.comparison.store import ResultStore
from lasergym.comparison.table import ResultTable
from lasergym.comparison.tasks import MILLING, TaskTarget, task_targets
from lasergym.comparison.work import Row, WorkItem, work_items
from lasergym.errors import OptionError

__all__ = ["Comparison", "Progress", "compare"]


@dataclass(frozen=True)
class Progress:
    """How far work of many items is.

    Attributes:
        done: Items that are finished, those of earlier runs included.
        total: All items.
        remaining_s: Expected time to the end, s; None before the first item of this run.
    """

    done: int
    total: int
    remaining_s: float | None


@dataclass(frozen=True)
class Comparison:
    """What a comparison has found.

    Attributes:
        rows: A result for every target and planner, in the order of the targets.
        table: Their means and spreads.
        files: What was written, tables first.
    """

    rows: tuple[Row, ...]
    table: ResultTable
    files: tuple[Path, ...]


def compare(
    options: CompareOptions,
    output: str | os.PathLike[str],
    *,
    jobs: int | None = None,
    ray_address: str | None = None,
    pictures: bool = True,
    shown: Sequence[str] = (),
    progress: Callable[[Progress], None] | None = None,
) -> Comparison:
    """Compares planners target by target.

    Results are written as they come. Called again with the same options and folder, the
    comparison goes on where it was killed. Planners without a time budget give the same results
    with any number of workers; seeds never depend on it.

    With several jobs, a script must call this under ``if __name__ == "__main__":``, since worker
    processes import it.

    Args:
        options: Targets, planners and budgets.
        output: Folder for ``settings.json``, ``results.csv``, ``table1.md``, ``table1.csv`` and
            pictures; made where missing.
        jobs: Worker processes, from 1 to 1024; by default one per available processor.
        ray_address: Ray cluster that does the work instead: ``"local"``, ``"auto"`` or an address.
        pictures: Whether to draw pictures, for which Matplotlib is needed.
        shown: Names of the targets whose trajectories are drawn; by default a few of each task.
        progress: Called after every item.

    Returns:
        The results and the files.

    Raises:
        OptionError: ``jobs`` is outside its range, or a shown target is none.
        DrawingError, TargetError: A drawing cannot be read or machined.
        PlanError: A planner refuses a target.
        ResultsError: The folder holds results of other settings, or damaged ones.
        MissingExtraError: Matplotlib or Ray is needed and not installed.
        FarmError: Workers cannot be reached or have died.
        KeyboardInterrupt: Ctrl-C; finished items are kept.
    """
    workers = _processors() if jobs is None else jobs
    if not 1 <= workers <= 1024:
        raise OptionError(f"jobs is {jobs}, but must be from 1 to 1024")
    if pictures:
        figures.require_matplotlib()
    targets = list(task_targets(options))
    drawn = [made for made in targets if made.task != MILLING]
    chosen = trajectories.choose_targets(drawn, shown) if drawn or shown else []
    folder = Path(output)
    if folder.exists() and not folder.is_dir():
        raise OptionError(f"{folder} is a file: give a folder with -o")
    settings = _settings(options, targets)
    items = [item for made in targets for item in work_items(options, made)]
    with ResultStore(folder, settings) as store:
        pending = [item for item in items if item.key not in store.rows]
        counter = _Counter(items, pending, progress)
        if pending:
            if ray_address is None:
                arriving = run_local(pending, workers)
            else:
                arriving = run_on_ray(pending, ray_address, jobs)
            for row in arriving:
                store.append(row)
                counter.add(row)
        rows = tuple(store.rows[item.key] for item in items)
    table = ResultTable(options.planners, group_rows(rows, options.planners), settings)
    files = [folder / "table1.md", folder / "table1.csv"]
    files[0].write_text(table.markdown(), encoding="utf-8")
    files[1].write_text(table.csv(), encoding="utf-8")
    if pictures:
        files += figures.draw_figures(folder, rows, options.planners)
        if chosen:
            files += trajectories.draw_trajectories(folder, chosen, rows, options.planners)
    return Comparison(rows, table, tuple(files))


class _Counter:
    """Counts items and foresees the end from the time that items are expected to take."""

    def __init__(
        self,
        items: Sequence[WorkItem],
        pending: Sequence[WorkItem],
        progress: Callable[[Progress], None] | None,
    ) -> None:
        self._progress = progress
        self._total = len(items)
        self._expected_s = {item.key: item.expected_s for item in pending}
        self._remaining_s = sum(self._expected_s.values())
        self._done_s = 0.0
        self._started_s = time.perf_counter()
        self._report(None)

    def add(self, row: Row) -> None:
        expected_s = self._expected_s.pop(row.key)
        self._done_s += expected_s
        self._remaining_s -= expected_s
        elapsed_s = time.perf_counter() - self._started_s
        self._report(max(0.0, elapsed_s / self._done_s * self._remaining_s))

    def _report(self, remaining_s: float | None) -> None:
        if self._progress is not None:
            done = self._total - len(self._expected_s)
            self._progress(Progress(done, self._total, remaining_s))


def _settings(options: CompareOptions, targets: Sequence[TaskTarget]) -> dict[str, Any]:
    """All that decides the results; drawings by what is in them, not by where they are."""
    timed = [planner for planner in options.planners if column_of(planner).timed]
    tasks = list(dict.fromkeys(made.task for made in targets))
    files = {task: options.policy_file(task) for task in tasks}
    spots = "200" if options.max_pulses is None else str(options.max_pulses)
    policies = {task: _content_digest(file) for task, file in files.items() if file is not None}
    return {
        "tasks": tasks,
        "targets": {task: _digest(made for made in targets if made.task == task) for task in tasks},
        "planners": list(options.planners),
        "max_pulses": "45, random shapes area/125"
        if options.max_pulses is None
        else str(options.max_pulses),
        "effort": {planner: str(options.effort(planner)) for planner in timed},
        "seed": options.seed,
        "version": lasergym.__version__,
        **({"policies": policies} if policies else {}),
        **({"process": options.process, "spots": spots} if MILLING in tasks else {}),
    }


def _content_digest(content: bytes) -> str:
    return hashlib.blake2b(content, digest_size=8).hexdigest()


def _digest(targets: Iterable[TaskTarget]) -> str:
    digest = hashlib.blake2b(digest_size=8)
    number = 0
    for made in targets:
        digest.update(made.name.encode() + b"\0" + made.bits)
        number += 1
    return f"{number} ({digest.hexdigest()})"


def _processors() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
