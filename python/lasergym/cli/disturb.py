"""``lasergym disturb``: what deciding pulse by pulse is worth, Fig. 8 of Xie et al. (2022)."""

from pathlib import Path
from typing import Annotated, Any, cast

import typer

from lasergym.cli.options import PolicyOption
from lasergym.cli.output import (
    note,
    print_data,
    print_json,
    progress_bar,
    rounded_time,
    table,
)
from lasergym.comparison import Progress
from lasergym.disturbances import Study, StudyOptions, draw_figures, run_study
from lasergym.disturbances.study import CONTESTANTS
from lasergym.disturbances.trials import CONTINUOUS

__all__ = ["disturb"]


def disturb(
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder for results and figures.")
    ] = Path("disturbances"),
    planner: Annotated[
        str, typer.Option(help="Who closes the loop: greedy, anneal, policy or agent-mpc.")
    ] = "agent-mpc",
    policy: PolicyOption = None,
    positions: Annotated[
        int, typer.Option(help="Take every n-th row and column of the 25 × 25 positions.")
    ] = 1,
    seeds: Annotated[
        int, typer.Option(help="Jobs for each level of vibration, backlash, drift, misfires.")
    ] = 20,
    max_pulses: Annotated[int, typer.Option(help="Most pulses that may be used.")] = 45,
    shape: Annotated[
        list[str] | None, typer.Option(help="Only this shape; may be repeated.")
    ] = None,
    moves: Annotated[int, typer.Option(help="Metropolis moves before each pulse.")] = 5000,
    pictures: Annotated[
        bool, typer.Option("--pictures/--no-pictures", help="Draw figures (needs Matplotlib).")
    ] = True,
    as_json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    """Displace and disturb pulses: closed loop against open loop.

    Results are written as they come: the same command goes on where it was stopped.
    """
    options = StudyOptions(
        planner=cast("Any", planner),
        policy=policy,
        positions=positions,
        seeds=seeds,
        max_pulses=max_pulses,
        moves=moves,
        shapes=tuple(shape or ()),
    )
    with progress_bar("disturbing") as bar:

        def show(progress: Progress) -> None:
            text = f"disturbing: {progress.done} of {progress.total}"
            if progress.remaining_s is not None:
                text += f", {rounded_time(progress.remaining_s)} left"
            bar.show(progress.done / progress.total, text)

        try:
            study = run_study(options, output, show)
        except KeyboardInterrupt:
            note(f"interrupted: results are in {output}, and the same command goes on from there")
            raise typer.Exit(1) from None
    if as_json:
        print_json(_summary(study))
    else:
        _print(study)
    files = [*study.files, *(draw_figures(study, output) if pictures else ())]
    for path in files:
        note(f"wrote {path}")


def _summary(study: Study) -> dict[str, Any]:
    return {
        "displaced": {name: study.displaced(name) for name in CONTESTANTS},
        **{
            disturbance: {
                name: {str(level): reward for level, reward in means.items()}
                for name in CONTESTANTS
                if (means := study.mean_reward(disturbance, name))
            }
            for disturbance in CONTINUOUS
        },
    }


def _print(study: Study) -> None:
    made = table(
        "5th pulse displaced", "within 0.01 of best", "95 % machined", "machined", "off", "reward"
    )
    for name, title in CONTESTANTS.items():
        figures = study.displaced(name)
        made.add_row(
            title,
            f"{figures['within_0_01']:.1%}",
            f"{figures['machined_95']:.1%}",
            f"{figures['machined_fraction']:.2%}",
            f"{figures['off_target_fraction']:.2%}",
            f"{figures['reward']:.4f}",
        )
    print_data(made)
    for disturbance in CONTINUOUS:
        levels = list(study.mean_reward(disturbance, "closed"))
        made = table(f"{disturbance}, mean reward", *(f"{level:g}" for level in levels))
        for name, title in CONTESTANTS.items():
            means = study.mean_reward(disturbance, name)
            made.add_row(title, *(f"{means[level]:.4f}" for level in levels))
        print_data("")
        print_data(made)
