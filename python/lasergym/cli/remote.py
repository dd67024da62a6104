"""``lasergym remote``: a task in; programs, picture, animation and report out."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, cast

import typer

import lasergym
from lasergym import remote as planning
from lasergym.cli.options import option
from lasergym.cli.output import note, print_data, print_json, table
from lasergym.cli.remote_figures import draw_figures
from lasergym.cli.remote_page import remote_page
from lasergym.errors import OptionError
from lasergym.remote import Choice, RemotePlan, Simulation

__all__ = ["remote"]

_SAMPLES = 40_000
"""States that the picture is drawn from, about."""


def remote(
    task: Annotated[
        Path, typer.Argument(metavar="TASK.toml", help="Subtasks, scanner, robot, planes.")
    ],
    output: Annotated[
        Path | None,
        option("-o", "--output", help="Folder for programs, picture, animation and report."),
    ] = None,
    choice: Annotated[
        str,
        option("--choice", help="joint, greedy, greedy-any-direction or initial."),
    ] = "joint",
    directions: Annotated[
        int, option("--directions", help="Directions of a turn that are tried.")
    ] = 360,
    keep_order: Annotated[bool, option("--keep-order", help="Keep the order of the task.")] = False,
    as_json: Annotated[bool, option("--json", help="Print the report as JSON.")] = False,
) -> None:
    """Plan robot lines and scanner programs for remote cutting and welding."""
    if output is not None and output.exists() and not output.is_dir():
        raise OptionError(f"output is {output}, which is a file: give the name of a folder")
    plan = planning.plan_file(
        task, choice=cast("Choice", choice), directions=directions, keep_order=keep_order
    )
    sample_s = plan.cycle_time_s / _SAMPLES
    simulation = plan.simulate(sample_s if output is not None else 0.0)
    report = {
        "task": str(task),
        **plan.as_dict(),
        "max_seam_error_mm": simulation.max_seam_error_mm,
        "max_speed_error_percent": 100 * simulation.max_speed_error,
        "max_field_mm": simulation.max_field_mm,
        "simulated_time_s": simulation.total_s,
        "feasible": not simulation.problems,
        "problems": list(simulation.problems),
        "version": lasergym.__version__,
    }
    if output is not None:
        write_job(output, plan, simulation, report)
    if as_json:
        print_json(report)
    else:
        print_data(_table(plan, simulation))
    for problem in simulation.problems:
        note(f"problem: {problem}")
    if simulation.problems:
        raise typer.Exit(1)


def write_job(
    folder: Path, plan: RemotePlan, simulation: Simulation, report: dict[str, Any]
) -> None:
    """Writes programs, picture, animation and report into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    programs = plan.programs()
    texts = {
        f"{programs.krl_name.lower()}.src": programs.krl_src,
        f"{programs.krl_name.lower()}.dat": programs.krl_dat,
        "robot.csv": programs.robot_csv,
        "scanner.csv": programs.scanner_csv,
        "scanner.rtc": programs.scanner_rtc,
        "animation.html": remote_page(plan, simulation),
        "report.json": json.dumps(report, indent=2) + "\n",
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    drawn = draw_figures(folder, plan, simulation)
    for name in (*texts, *drawn):
        note(f"wrote {folder / name}")
    if not drawn:
        note("no picture: pip install 'lasergym[plots]'")


def _table(plan: RemotePlan, simulation: Simulation) -> Any:
    made = table("line", "subtasks", "direction", "speed", "length", "time")
    for number, line in enumerate(plan.lines, start=1):
        made.add_row(
            str(number),
            str(len(line.stops)),
            f"{line.direction_deg:.1f}°",
            f"{line.speed_mm_s:.1f} mm/s",
            f"{line.length_mm:.1f} mm",
            f"{line.time_s:.3f} s",
        )
    made.caption = (
        f"{plan.cycle_time_s:.3f} s in all, laser on {plan.laser_s:.3f} s; seam within "
        f"{1e3 * simulation.max_seam_error_mm:.1f} µm; planned in {1e3 * plan.elapsed_s:.1f} ms"
    )
    return made
