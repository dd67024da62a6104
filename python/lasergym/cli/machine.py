"""``lasergym machine``: a drawing machined pulse by pulse under a camera."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Annotated, Any, cast

import typer

from lasergym.cli.drivers_file import drivers_from
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
from lasergym.cli.output import note, print_data, print_json, progress_bar, table
from lasergym.cli.target_name import read_target
from lasergym.errors import OptionError
from lasergym.machine import (
    PRESETS,
    Deciding,
    Drivers,
    JobOptions,
    JobProgress,
    JobReport,
    SimulatedMachine,
    resume_job,
    run_job,
)
from lasergym.machine.report import REPORT_FILES

__all__ = ["exit_code", "machine", "print_job", "shown", "stop_on_signals"]

_DECIDING = "Deciding"
_SIMULATED = "Simulated machine"
_REAL = "Real machine"

_PLANNERS = ("greedy", "policy", "agent-mpc", "anneal")


def machine(
    target: Annotated[
        str | None,
        typer.Argument(
            metavar="[TARGET]",
            help="A PNG, JPEG, SVG or DXF drawing, or star, star:30 (°), random-shape:7 (seed).",
        ),
    ] = None,
    output: Annotated[
        Path | None, option("-o", "--output", help="New folder for journal, frames and report.")
    ] = None,
    resume: Annotated[
        Path | None, option("--resume", help="Go on with the job in this folder.")
    ] = None,
    preset: Annotated[
        str, option("--preset", help=f"One of {', '.join(PRESETS)}.", panel=_SIMULATED)
    ] = "lab",
    effect: Annotated[
        list[str] | None,
        option(
            "--effect", help="Another error, like backlash_um=2; may be repeated.", panel=_SIMULATED
        ),
    ] = None,
    planner: Annotated[
        str, option("--planner", help=f"One of {', '.join(_PLANNERS)}.", panel=_DECIDING)
    ] = "anneal",
    policy: PolicyOption = None,
    pointing_error_um: PointingErrorOption = 0.0,
    thinking_s: Annotated[
        float,
        option(
            "--thinking-s", help="Time before each pulse of anneal, agent-mpc, s.", panel=_DECIDING
        ),
    ] = 0.05,
    seed: Annotated[int, option("--seed", help="Seed of planner and simulated machine.")] = 0,
    max_pulses: Annotated[int, option("--max-pulses", help="Most pulses that may be used.")] = 45,
    pulse_radius_um: Annotated[
        float, option("--pulse-radius-um", help="Radius of the mark of one pulse, µm.")
    ] = 9.0,
    drivers: Annotated[
        Path | None,
        option(
            "--drivers",
            help="Python file whose connect() gives stage, laser and camera.",
            panel=_REAL,
        ),
    ] = None,
    calibration: Annotated[
        Path | None,
        option("--calibration", help="Calibration file of camera and stage.", panel=_REAL),
    ] = None,
    tolerance_um: Annotated[
        float,
        option("--tolerance-um", help="Largest error of the stage when firing, µm.", panel=_REAL),
    ] = 0.5,
    exposure_s: Annotated[
        float | None, option("--exposure-s", help="Exposure of the camera, s.", panel=_REAL)
    ] = None,
    arm: Annotated[
        bool,
        option("--arm", help="Let real drivers fire; without it, a dry run.", panel=_REAL),
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the report as JSON.")] = False,
    margin_px: MarginOption = 5.0,
    threshold: ThresholdOption = 0.5,
    ink: InkOption = "auto",
    invert: InvertOption = False,
    fit: FitOption = "scale",
) -> None:
    """Machine a drawing pulse by pulse, correcting what the camera sees.

    The machine is simulated unless --drivers names a real one. After a crash or Ctrl-C,
    --resume goes on.
    """
    options = JobOptions(
        max_pulses=max_pulses,
        pulse_radius_px=pulse_radius_um,
        tolerance_um=tolerance_um,
        exposure_s=exposure_s,
    )
    if (target is None) == (resume is None):
        raise OptionError("give either TARGET and -o, or --resume and the folder of a job")
    if (drivers is None) != (calibration is None):
        raise OptionError("--drivers and --calibration belong together")
    real = None if drivers is None or calibration is None else drivers_from(drivers, calibration)
    folder = resume or output
    if folder is None:
        raise OptionError("-o is missing: name a new folder for the job")
    with stop_on_signals() as received, progress_bar("machining") as bar:
        show = shown(bar.show)
        if resume is not None:
            report = resume_job(resume, real, policy=policy, arm=arm, progress=show)
        else:
            report = run_job(
                read_target(
                    str(target),
                    margin_px=margin_px,
                    threshold=threshold,
                    ink=cast("Any", ink),
                    invert=invert,
                    fit=cast("Any", fit),
                ),
                folder,
                real or _simulated(preset, effect or [], seed),
                deciding=Deciding(
                    planner=cast("Any", planner),
                    policy=policy,
                    seed=seed,
                    thinking_s=thinking_s,
                    pointing_error_px=pointing_error_um,
                ),
                options=options,
                arm=arm,
                progress=show,
            )
    print_job(report, as_json=as_json)
    code = exit_code(report, received)
    if code != 0:
        note(_advice(report, folder, drivers))
        raise typer.Exit(code)
    if isinstance(real, Drivers) and not arm:
        note("this was a dry run: nothing was fired; --arm fires")


@contextmanager
def stop_on_signals() -> Iterator[list[int]]:
    """SIGTERM stops the job as Ctrl-C does; gives the list of the signals that have come."""
    received: list[int] = []

    def stop(number: int, _frame: FrameType | None) -> None:
        received.append(number)
        raise KeyboardInterrupt

    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, stop) for number in numbers]
    try:
        yield received
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


def print_job(report: JobReport, *, as_json: bool) -> None:
    """Prints a report on stdout, and on stderr which files have it."""
    if as_json:
        print_json(report.as_dict())
    else:
        made = table("reward", "machined", "off target", "pulses", "faults", "time", texts=0)
        made.add_row(
            f"{report.reward:.4f}",
            f"{report.machined_fraction:.2%}",
            f"{report.off_target_fraction:.2%}",
            str(report.pulses),
            str(len(report.faults)),
            f"{report.elapsed_s:.1f} s",
        )
        print_data(made)
        total_s = sum(report.phases.values())
        shares = ", ".join(
            f"{name.removesuffix('_s')} {time_s / total_s:.1%}"
            for name, time_s in report.phases.items()
            if total_s > 0
        )
        print_data(f"time: {shares}" if shares else "time: not known")
    for name in REPORT_FILES:
        note(f"wrote {report.folder / name}")


def shown(show: Any) -> Any:
    """A callback that shows the progress of a job in a bar."""

    def tell(progress: JobProgress) -> None:
        show(
            progress.pulses / progress.max_pulses,
            f"pulse {progress.pulses}/{progress.max_pulses} {progress.verdict}: "
            f"{progress.machined_fraction:.1%} machined, {progress.off_target_fraction:.1%} off",
        )

    return tell


def _simulated(preset: str, effects: list[str], seed: int) -> SimulatedMachine:
    if preset not in PRESETS:
        raise OptionError(f"preset is {preset!r}, but must be one of {', '.join(PRESETS)}")
    values: dict[str, float] = {}
    for effect in effects:
        name, given, value = effect.partition("=")
        try:
            values[name] = float(value) if "." in value or "e" in value else int(value)
        except ValueError:
            given = ""
        if not given:
            raise OptionError(f"--effect is {effect!r}, but must be like backlash_um=2")
    return SimulatedMachine(preset=cast("Any", preset), effects=values, seed=seed)


def exit_code(report: JobReport, received: list[int]) -> int:
    """0 for a job with nothing left to do, 128 + the signal that stopped it, otherwise 1."""
    if report.complete:
        return 0
    if report.status == "interrupted":
        return 128 + (received[0] if received else signal.SIGINT)
    return 1


def _advice(report: JobReport, folder: Path, drivers: Path | None) -> str:
    reason = report.status.replace("_", " ")
    if report.status == "fault" and report.faults:
        last = report.faults[-1]
        reason = f"{last.device} fault ({last.fault}): {last.message}"
    again = f"lasergym machine --resume {folder}"
    if drivers is not None:
        again += f" --drivers {drivers} --calibration FILE --arm"
    return f"stopped, the laser is off: {reason}; go on with: {again}"
