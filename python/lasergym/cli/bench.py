"""``lasergym bench``: how fast the environments step, beside NumPy and ``SyncVectorEnv``."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from lasergym.cli.bench_report import BenchReport
from lasergym.cli.machine_facts import machine_facts, threads_available
from lasergym.cli.memory import MemoryUse, memory_of
from lasergym.cli.output import note, print_data, print_json, progress_bar
from lasergym.cli.steppers import changed_px, make_steppers, shape_time_us
from lasergym.cli.throughput import Throughput, measure
from lasergym.errors import OptionError

__all__ = ["bench"]

_TASKS = ("Star", "RandomShape")
_ENDINGS = (".json", ".md")


def bench(
    envs: Annotated[
        str, typer.Option("--envs", help="Numbers of environments, separated by commas.")
    ] = "1,64,1024,16384",
    seconds: Annotated[
        float, typer.Option("--seconds", help="Least time of one repetition, s.", min=0.0)
    ] = 0.5,
    repetitions: Annotated[
        int, typer.Option("--repetitions", help="Of which the median counts.", min=1, max=1000)
    ] = 5,
    threads: Annotated[
        int | None,
        typer.Option("--threads", help="Worker threads of the second column.", min=1, max=1024),
    ] = None,
    numpy_oracle: Annotated[
        Path | None,
        typer.Option("--numpy-oracle", help="File with class NumpyAblation to compare with."),
    ] = None,
    sync_max_envs: Annotated[
        int,
        typer.Option("--sync-max-envs", help="Most environments of SyncVectorEnv.", min=0),
    ] = 1024,
    memory_envs: Annotated[
        int,
        typer.Option("--memory-envs", help="Environments whose memory is measured.", min=0),
    ] = 65_536,
    output: Annotated[
        list[Path] | None,
        typer.Option("-o", "--output", help="Write the report, .json or .md; may be repeated."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the report as JSON.")] = False,
    markdown: Annotated[
        bool, typer.Option("--markdown", help="Print the tables as Markdown.")
    ] = False,
) -> None:
    """Measure steps per second with random actions, resets included."""
    counts = _counts(envs)
    files = output or []
    for path in files:
        if path.suffix.lower() not in _ENDINGS or not path.parent.is_dir():
            raise OptionError(f"{path} must be a .json or .md file in an existing folder")
    if numpy_oracle is not None and not numpy_oracle.is_file():
        note(f"{numpy_oracle} is not found: NumPy is left out")
        numpy_oracle = None
    rows: list[Throughput] = []
    with progress_bar("measuring") as bar:
        for index, (task, count) in enumerate((t, n) for t in _TASKS for n in counts):
            bar.show(index / (len(_TASKS) * len(counts)), f"{task}, {count} environments")
            steppers = make_steppers(
                task,
                count,
                threads=threads or threads_available(),
                numpy_oracle=numpy_oracle,
                sync_max_envs=sync_max_envs,
            )
            rows += measure(steppers, seconds=seconds, repetitions=repetitions)
        bar.show(1.0, "measuring shapes and memory")
        shape_us = shape_time_us()
        memory: MemoryUse | None = memory_of(memory_envs) if memory_envs else None
    changed = {task: changed_px(task) for task in _TASKS}
    report = BenchReport(machine_facts(), tuple(rows), changed, shape_us, memory)
    for path in files:
        path.write_text(_file_text(report, path), encoding="utf-8")
        note(f"wrote {path}")
    if as_json:
        print_json(report.as_dict())
    elif markdown:
        print_data(report.markdown())
    else:
        for part in report.parts():
            print_data(part)


def _counts(text: str) -> list[int]:
    try:
        counts = [int(part) for part in text.split(",")]
    except ValueError as error:
        raise OptionError(f"--envs {text} is no list such as 1,64,1024") from error
    if not all(1 <= count <= 1_000_000 for count in counts):
        raise OptionError(f"--envs {text}: every number must be from 1 to 1000000")
    return counts


def _file_text(report: BenchReport, path: Path) -> str:
    if path.suffix.lower() == ".md":
        return report.markdown()
    as_dict: dict[str, Any] = report.as_dict()
    return json.dumps(as_dict, indent=2) + "\n"
