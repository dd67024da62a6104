"""``lasergym plan``: a drawing in, a scored toolpath and a machine program out."""

from pathlib import Path
from typing import Annotated, Any, cast

import typer

import lasergym
from lasergym.cli.options import (
    FitOption,
    InkOption,
    InvertOption,
    MarginOption,
    PointingErrorOption,
    PolicyOption,
    ThresholdOption,
    option,
)
from lasergym.cli.output import note, print_data, print_json, progress_bar
from lasergym.cli.plan_files import check_files, write_file
from lasergym.cli.plan_report import judge
from lasergym.cli.target_name import read_target
from lasergym.errors import OptionError
from lasergym.planners import LEARNED_PLANNERS, PLANNERS, PlannerName
from lasergym.programs import GcodeOptions, StageDynamics, WorkpieceFrame

__all__ = ["plan"]

_SEARCH = "Search"
_MACHINE = "Machine"


def plan(
    target: Annotated[
        str,
        typer.Argument(
            metavar="TARGET",
            help="A PNG, JPEG, SVG or DXF drawing, or star, star:30 (°), random-shape:7 (seed).",
        ),
    ],
    planner: Annotated[str, option("--planner", help=f"One of {', '.join(PLANNERS)}.")] = "anneal",
    max_pulses: Annotated[int, option("--max-pulses", help="Most pulses that may be used.")] = 45,
    pulse_radius_um: Annotated[
        float, option("--pulse-radius-um", help="Radius of the mark of one pulse, µm.")
    ] = 9.0,
    output: Annotated[
        list[Path] | None,
        option(
            "-o",
            "--output",
            help="Write .csv, .nc or .gcode (GRBL), .svg, .png or .json; may be repeated.",
        ),
    ] = None,
    preview: Annotated[
        Path | None, option("--preview", help="Write a picture of the plan, .png or .svg.")
    ] = None,
    policy: PolicyOption = None,
    pointing_error_um: PointingErrorOption = 0.0,
    seed: Annotated[int, option("--seed", help="Seed of anneal and cma-es.", panel=_SEARCH)] = 0,
    budget_s: Annotated[
        float | None,
        option("--budget-s", help="Time, s; default: 1 for anneal, 60 for cma-es.", panel=_SEARCH),
    ] = None,
    iterations: Annotated[
        int | None,
        option("--iterations", help="Work instead of time: the same plan anywhere.", panel=_SEARCH),
    ] = None,
    threads: Annotated[
        int, option("--threads", help="Threads of anneal and cma-es.", panel=_SEARCH)
    ] = 1,
    restarts: Annotated[
        int, option("--restarts", help="Runs of anneal, of which the best counts.", panel=_SEARCH)
    ] = 1,
    keep_order: Annotated[
        bool,
        option("--keep-order", help="Fire as planned, not by shortest travel.", panel=_SEARCH),
    ] = False,
    as_json: Annotated[
        bool,
        option("--json", help="Print the report as JSON; with FILE.json, write it there."),
    ] = False,
    margin_px: MarginOption = 5.0,
    threshold: ThresholdOption = 0.5,
    ink: InkOption = "auto",
    invert: InvertOption = False,
    fit: FitOption = "scale",
    pixel_um: Annotated[
        float, option("--pixel-um", help="Side of a pixel, µm.", panel=_MACHINE)
    ] = 1.0,
    power: Annotated[
        float, option("--power", help="Laser power, as the word S of GRBL.", panel=_MACHINE)
    ] = 1000.0,
    dwell_s: Annotated[
        float, option("--dwell-s", help="Time the laser is on for a pulse, s.", panel=_MACHINE)
    ] = 0.05,
    settling_s: Annotated[
        float, option("--settling-s", help="Wait before each pulse, s.", panel=_MACHINE)
    ] = 0.05,
    feed_mm_min: Annotated[
        float | None,
        option("--feed-mm-min", help="Feed rate of moves; default: rapid moves.", panel=_MACHINE),
    ] = None,
    origin_x_mm: Annotated[
        float, option("--origin-x-mm", help="Left edge of the workpiece, mm.", panel=_MACHINE)
    ] = 0.0,
    origin_y_mm: Annotated[
        float, option("--origin-y-mm", help="Edge of lowest y, mm.", panel=_MACHINE)
    ] = 0.0,
    y_axis: Annotated[
        str, option("--y-axis", help="Sense of the machine's y: up or down.", panel=_MACHINE)
    ] = "up",
    speed_um_s: Annotated[
        float, option("--speed-um-s", help="Highest speed of the stage, µm/s.", panel=_MACHINE)
    ] = 5000.0,
    acceleration_um_s2: Annotated[
        float, option("--acceleration-um-s2", help="Of the stage, µm/s².", panel=_MACHINE)
    ] = 50_000.0,
) -> None:
    """Plan the pulses that machine a drawing.

    Prints the score beside those of simple planners. The workpiece has 100 × 100 pixels.
    """
    files = [*(output or []), *([] if preview is None else [preview])]
    check_files(files)
    if not 0 < pixel_um < float("inf"):
        raise OptionError(f"pixel_um is {pixel_um}, but must be above 0")
    pattern = read_target(
        target,
        margin_px=margin_px,
        threshold=threshold,
        ink=cast("Any", ink),
        invert=invert,
        fit=cast("Any", fit),
    )
    frame = WorkpieceFrame(
        origin_x_mm=origin_x_mm,
        origin_y_mm=origin_y_mm,
        y_axis=cast("Any", y_axis),
        pixel_um=pixel_um,
    )
    gcode = GcodeOptions(
        frame=frame, power_s=power, dwell_s=dwell_s, settling_s=settling_s, feed_mm_min=feed_mm_min
    )
    dynamics = StageDynamics(
        max_speed_um_s=speed_um_s,
        acceleration_um_s2=acceleration_um_s2,
        settling_s=settling_s,
        pulse_s=dwell_s,
    )
    with progress_bar(f"planning ({planner})") as bar:
        made = lasergym.plan(
            pattern,
            cast("PlannerName", planner),
            max_pulses=max_pulses,
            pulse_radius_px=pulse_radius_um / pixel_um,
            seed=seed,
            budget_s=budget_s,
            iterations=iterations,
            threads=threads,
            restarts=restarts,
            policy=policy,
            pointing_error_px=pointing_error_um / pixel_um,
            progress=lambda fraction, _reward: bar.show(fraction),
        )
    if not keep_order and planner not in LEARNED_PLANNERS:
        made = made.ordered()
    report = judge(
        target, pattern, made, max_pulses=max_pulses, pixel_um=pixel_um, dynamics=dynamics
    )
    for path in files:
        write_file(path, report, pattern, gcode=gcode)
        note(f"wrote {path}")
    if as_json:
        print_json(report.as_dict())
    else:
        print_data(report.table())
        print_data(report.travel_line())
    if made.partial:
        note("stopped early: this is the best plan so far")
        raise typer.Exit(1)
