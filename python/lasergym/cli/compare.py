"""``lasergym compare``: planners side by side, Table 1 of Xie et al. (2022)."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated, cast

import typer
from rich.table import Table

from lasergym.cli.options import (
    PLANNERS_PANEL,
    AnglesOption,
    AnnealIterationsOption,
    AnnealTimeOption,
    CmaEsTimeOption,
    FoldersArgument,
    ShapesOption,
    option,
)
from lasergym.cli.output import (
    note,
    print_data,
    print_json,
    progress_bar,
    rounded_time,
    table,
)
from lasergym.comparison import CompareOptions, Comparison, Progress, PulseBudget
from lasergym.comparison import compare as run_comparison
from lasergym.comparison.columns import default_planners
from lasergym.comparison.tasks import TaskName
from lasergym.errors import OptionError

__all__ = ["compare"]

_WORK = "Work"


def compare(
    folders: FoldersArgument = None,
    task: Annotated[
        list[str] | None,
        option(
            "--task",
            help="star, rotated-star, random-shapes, milling, or folder DIR; may be repeated. "
            "Default: star, or the folders where given.",
        ),
    ] = None,
    output: Annotated[
        Path, option("-o", "--output", help="Folder for results, tables and pictures.")
    ] = Path("comparison"),
    angles: AnglesOption = 360,
    shapes: ShapesOption = 100,
    reliefs: Annotated[
        int, option("--reliefs", help="Random depth maps of the task milling.")
    ] = 10,
    process: Annotated[
        str, option("--process", help="Process of the task milling, or a TOML profile.")
    ] = "laser-graphite",
    max_pulses: Annotated[
        str | None,
        option(
            "--max-pulses",
            help="Pulse budget, like 45 or area/125. "
            "Default: 45, random shapes area/125, milling 200.",
        ),
    ] = None,
    planners: Annotated[
        str | None,
        option(
            "--planners",
            help="Columns, separated by commas. Default: raster to cma-es; for milling "
            "pixel-by-pixel and adjoint.",
            panel=PLANNERS_PANEL,
        ),
    ] = None,
    anneal_s: AnnealTimeOption = 1.0,
    cma_es_s: CmaEsTimeOption = 60.0,
    anneal_iterations: AnnealIterationsOption = None,
    cma_es_iterations: Annotated[
        int | None,
        option(
            "--cma-es-iterations",
            help="Evaluations of CMA-ES instead of its time.",
            panel=PLANNERS_PANEL,
        ),
    ] = None,
    policy: Annotated[
        str | None,
        option(
            "--policy",
            help="For policy and agent-mpc: star, rotated-star, random-shape, or a file. "
            "Default: the one trained for the task.",
            panel=PLANNERS_PANEL,
        ),
    ] = None,
    seed: Annotated[
        int, option("--seed", help="Every item's seed derives from it.", panel=PLANNERS_PANEL)
    ] = 0,
    jobs: Annotated[
        int | None,
        option("--jobs", help="Worker processes; default: one per processor.", panel=_WORK),
    ] = None,
    ray: Annotated[
        str | None,
        option(
            "--ray",
            help="Let a Ray cluster do the work: local (start one here), auto or its address.",
            panel=_WORK,
        ),
    ] = None,
    pictures: Annotated[
        bool, option("--pictures/--no-pictures", help="Draw pictures (needs Matplotlib).")
    ] = True,
    show: Annotated[
        list[str] | None,
        option("--show", help="Target whose trajectories are drawn; may be repeated."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the table as JSON.")] = False,
) -> None:
    """Compare planners target by target, as Table 1 of Xie et al. (2022) does.

    Results are written as they come: the same command goes on where it was stopped.
    """
    if output.suffix.lower() in (".json", ".csv", ".md"):
        raise OptionError(f"{output} looks like a file, but -o takes a folder")
    given = tuple(folders or ())
    tasks = tuple(task or (() if given else ("star",)))
    if given and "folder" not in tasks:
        tasks = (*tasks, "folder")
    options = CompareOptions(
        tasks=cast("tuple[TaskName, ...]", tasks),
        folders=given,
        angles=angles,
        shapes=shapes,
        reliefs=reliefs,
        process=process,
        planners=default_planners(tasks)
        if planners is None
        else tuple(name.strip() for name in planners.split(",")),
        max_pulses=None if max_pulses is None else PulseBudget.parse(max_pulses),
        anneal_s=anneal_s,
        cma_es_s=cma_es_s,
        anneal_iterations=anneal_iterations,
        cma_es_iterations=cma_es_iterations,
        policy=policy,
        seed=seed,
    )
    last = Progress(0, 0, None)
    with progress_bar("comparing") as bar:

        def show_progress(progress: Progress) -> None:
            nonlocal last
            last = progress
            bar.show(progress.done / progress.total, _description(progress))

        try:
            comparison = run_comparison(
                options,
                output,
                jobs=jobs,
                ray_address=ray,
                pictures=pictures,
                shown=tuple(show or ()),
                progress=show_progress,
            )
        except KeyboardInterrupt:
            note(_interruption(last, output))
            raise typer.Exit(1) from None
    _print(comparison, as_json=as_json)
    for path in comparison.files:
        note(f"wrote {path}")


def _print(comparison: Comparison, *, as_json: bool) -> None:
    result = comparison.table
    if as_json:
        print_json(result.as_dict())
        return
    header = ("", *result.titles())
    for group in result.groups:
        if group.whole_task:
            print_data(f"{group.name} ({group.targets})")
            # The spread goes below the mean, so that five columns fit 80 characters.
            cells = ([cell.replace(" ± ", "\n± ") for cell in row] for row in result.rows_of(group))
            print_data(_aligned(header, cells))
            print_data("")
    for matrix in result.matrices():
        print_data(f"{matrix.task}: targets on which the row is at least as good as the column")
        print_data(_aligned(header, matrix.rows()))
        print_data("")


def _aligned(header: Sequence[str], rows: Iterable[Sequence[str]]) -> Table:
    made = table(*header)
    for cells in rows:
        made.add_row(*cells)
    return made


def _interruption(progress: Progress, output: Path) -> str:
    if progress.total == 0:
        return "interrupted"
    return (
        f"interrupted: {progress.done} of {progress.total} results are in {output}, "
        "and the same command goes on from there"
    )


def _description(progress: Progress) -> str:
    counted = f"comparing: {progress.done} of {progress.total}"
    if progress.remaining_s is None:
        return counted
    return f"{counted}, {rounded_time(progress.remaining_s)} left"
