"""``lasergym demo``: a drawing planned, then machined under the camera of a simulated machine."""

from pathlib import Path
from typing import Annotated

import typer

import lasergym
from lasergym import targets
from lasergym.cli.machine import exit_code, print_job, shown, stop_on_signals
from lasergym.cli.output import note, print_data, progress_bar
from lasergym.cli.plan_files import write_file
from lasergym.cli.plan_report import judge
from lasergym.machine import Deciding, JobOptions, SimulatedMachine, run_job
from lasergym.machine.journal import JOURNAL_NAME
from lasergym.machine.report import RIG_NAME
from lasergym.planners import PlannerName
from lasergym.programs import GcodeOptions, StageDynamics

__all__ = ["demo"]

_PLANNER: PlannerName = "anneal"
_ITERATIONS = 2_000_000
_MOVES = 20_000
"""Work of the planner, first and before each pulse: the demo is the same on every machine."""


def demo(
    target: Annotated[
        Path, typer.Argument(metavar="TARGET", help="A PNG, JPEG, SVG or DXF drawing.")
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="New folder for the files.")
    ] = Path("demo"),
    max_pulses: Annotated[int, typer.Option(help="Most pulses that may be used.")] = 45,
    as_json: Annotated[bool, typer.Option("--json", help="Print the report as JSON.")] = False,
) -> None:
    """Plan a drawing, then machine it on the simulated machine, correcting what its camera sees.

    Leaves the plan (picture and program) and the job (journal, frames, report.html).
    """
    pattern = targets.load(target)
    with progress_bar(f"planning ({_PLANNER})") as bar:
        planned = lasergym.plan(
            pattern,
            _PLANNER,
            max_pulses=max_pulses,
            iterations=_ITERATIONS,
            progress=lambda fraction, _reward: bar.show(fraction),
        ).ordered()
    gcode = GcodeOptions()
    dynamics = StageDynamics(settling_s=gcode.settling_s, pulse_s=gcode.dwell_s)
    report = judge(
        str(target), pattern, planned, max_pulses=max_pulses, pixel_um=1.0, dynamics=dynamics
    )
    _clear(output)
    with stop_on_signals() as received, progress_bar("machining") as bar:
        job = run_job(
            pattern,
            output,
            SimulatedMachine(preset="lab"),
            deciding=Deciding(planner="anneal", first_iterations=_ITERATIONS, moves=_MOVES),
            options=JobOptions(max_pulses=max_pulses),
            progress=shown(bar.show),
        )
    for name in ("plan.png", "plan.svg", "plan.json", "toolpath.nc", "toolpath.csv"):
        write_file(output / name, report, pattern, gcode=gcode)
        note(f"wrote {output / name}")
    if not as_json:
        print_data(report.table())
        print_data(report.travel_line())
        print_data("")
        print_data("and machined on the simulated machine, from what its camera saw:")
    print_job(job, as_json=as_json)
    if exit_code(job, received) != 0:
        raise typer.Exit(exit_code(job, received))


def _clear(folder: Path) -> None:
    """Removes the job of an earlier demo; one of a real machine stays where it is."""
    if not (folder / RIG_NAME).is_file():
        return
    for path in (folder / JOURNAL_NAME, folder / RIG_NAME, *(folder / "frames").glob("*.png")):
        path.unlink(missing_ok=True)
