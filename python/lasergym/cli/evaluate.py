"""``lasergym evaluate``: a trained agent beside planners, as in Table 1 of Xie et al. (2022)."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

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
from lasergym.cli.output import note, print_data, print_json, progress_bar, table
from lasergym.comparison import CompareOptions, PulseBudget
from lasergym.comparison.tasks import TaskName
from lasergym.errors import OptionError

if TYPE_CHECKING:
    from lasergym.training.agents import Agent
    from lasergym.training.evaluation import AgentComparison

__all__ = ["evaluate"]


_TASKS: dict[str, TaskName] = {
    "lasergym/Star-v0": "star",
    "lasergym/RotatedStar-v0": "rotated-star",
    "lasergym/RandomShape-v0": "random-shapes",
}


def evaluate(
    model: Annotated[
        Path, typer.Argument(metavar="RUN_OR_MODEL", help="Folder of a run, or a model's .zip.")
    ],
    folders: FoldersArgument = None,
    task: Annotated[
        list[str] | None,
        option(
            "--task",
            help="star, rotated-star, random-shapes, or folder DIR; may be repeated. "
            "Default: what the agent was trained on.",
        ),
    ] = None,
    output: Annotated[
        Path | None, option("-o", "--output", help="Write the report to this JSON file.")
    ] = None,
    angles: AnglesOption = 360,
    shapes: ShapesOption = 100,
    max_pulses: Annotated[
        str | None,
        option(
            "--max-pulses",
            help="Pulse budget, like 45 or area/125. Default: 45, random shapes area/125.",
        ),
    ] = None,
    batch: Annotated[
        int,
        option("--batch", help="Targets that the agent works on at once; 1 times a single one."),
    ] = 64,
    planners: Annotated[
        str, option("--planners", help="Other columns, separated by commas.", panel=PLANNERS_PANEL)
    ] = "greedy",
    anneal_s: AnnealTimeOption = 1.0,
    cma_es_s: CmaEsTimeOption = 60.0,
    anneal_iterations: AnnealIterationsOption = None,
    seed: Annotated[
        int, option("--seed", help="The planners' seeds derive from it.", panel=PLANNERS_PANEL)
    ] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print the report as JSON.")] = False,
) -> None:
    """Evaluate a trained agent beside planners, without exploration.

    The targets are those of lasergym compare: no agent of lasergym is trained on its random shapes.
    """
    if output is not None and not output.parent.is_dir():
        raise OptionError(f"there is no folder {output.parent} for the report")
    import lasergym.sb3  # noqa: F401 - first, since it says what to install
    from lasergym.training.agents import load_agent  # Imports torch.
    from lasergym.training.evaluation import compare_agent

    agent = load_agent(model)
    given = tuple(folders or ())
    tasks = tuple(task or (() if given else (_task_of(agent),)))
    if given and "folder" not in tasks:
        tasks = (*tasks, "folder")
    options = CompareOptions(
        tasks=cast("tuple[TaskName, ...]", tasks),
        folders=given,
        angles=angles,
        shapes=shapes,
        planners=tuple(name.strip() for name in planners.split(",")),
        max_pulses=None if max_pulses is None else PulseBudget.parse(max_pulses),
        anneal_s=anneal_s,
        cma_es_s=cma_es_s,
        anneal_iterations=anneal_iterations,
        seed=seed,
    )
    with progress_bar("evaluating") as bar:
        comparison = compare_agent(agent, options, batch=batch, progress=bar.show)
    report = {"model": str(model), **comparison.as_dict()}
    if output is not None:
        output.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    if as_json:
        print_json(report)
    else:
        _print(comparison)
    if output is not None:
        note(f"wrote {output}")


def _task_of(agent: "Agent") -> TaskName:
    """The task of Table 1 that an agent was trained on; the star where it does not tell."""
    return "star" if agent.task is None else _TASKS.get(agent.task.env_id, "star")


def _print(comparison: "AgentComparison") -> None:
    from lasergym.training.evaluation import well_machined_percent

    result = comparison.table
    for group in result.groups:
        if not group.whole_task:
            continue
        print_data(f"{group.name} ({group.targets})")
        made = table("", *result.titles())
        for cells in result.rows_of(group):
            made.add_row(*cells)
        shares = [
            well_machined_percent(comparison.rows_of(group.name, planner))
            for planner in result.planners
        ]
        made.add_row("machined over 90 %", *(f"{share:.0f} % of them" for share in shares))
        print_data(made)
        print_data("")
    if comparison.batch > 1:
        note(f"the agent worked on up to {comparison.batch} targets at once: its time is a share")
