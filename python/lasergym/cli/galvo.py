"""``lasergym galvo``: calibrate a scan head, postprocess jobs for it, simulate programs on it."""

from __future__ import annotations

import time
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal, cast

import typer

import lasergym
from lasergym import galvo as heads
from lasergym.cli.options import option
from lasergym.cli.output import note, print_data, print_json, table
from lasergym.errors import OptionError

__all__ = ["galvo"]

galvo = typer.Typer(
    help="Calibrate scan heads, postprocess jobs for them, simulate programs on them.",
    no_args_is_help=True,
)

_HEAD_HELP = f"{', '.join(heads.HEADS)}, or a TOML file."

HeadOption = Annotated[str, option("--head", "--calibration", help=_HEAD_HELP)]
BeamOption = Annotated[float, option("--beam-um", help="Diameter of a crater, µm.")]
JsonOption = Annotated[bool, option("--json", help="Print the report as JSON.")]


@galvo.command("calibrate")
def calibrate(
    lines: Annotated[
        Path | None,
        typer.Argument(
            metavar="[LINES]",
            help="Measured lines: speed_m_s,nominal_um,measured_um,acceleration_um; columns axis "
            "and acceleration_time_us may follow.",
        ),
    ] = None,
    output: Annotated[
        Path | None, option("-o", "--output", help="Head file to write, or the test pattern.")
    ] = None,
    pattern: Annotated[
        bool, option("--pattern", help="Write the lines to machine and measure instead.")
    ] = False,
    head: Annotated[
        str | None, option("--head", help="Head file whose axes and laser are kept.")
    ] = None,
    speeds_m_s: Annotated[
        str, option("--speeds-m-s", help="Speeds of the pattern, m/s.")
    ] = "0.5,1,1.5,2",
    length_um: Annotated[float, option("--length-um", help="Length of its lines, µm.")] = 2000.0,
    repeats: Annotated[int, option("--repeats", help="Lines at each speed and axis.")] = 10,
    as_json: JsonOption = False,
) -> None:
    """Fit lag and acceleration length to measured test lines, or write the lines to machine."""
    if pattern:
        speeds = _numbers("speeds_m_s", speeds_m_s)
        text = heads.line_pattern(speeds, length_um=length_um, repeats=repeats)
        _write(output, text)
        return
    if lines is None:
        raise OptionError("give a file of measured LINES, or --pattern for what to machine")
    found = heads.calibrate(lines)
    if output is not None:
        kept = "" if head is None else _without("calibration", heads.head_text(head))
        _write(output, kept + found.toml)
    if as_json:
        print_json({**found.as_dict(), "version": lasergym.__version__})
        return
    made = table("", "intercept µm", "± 95 %", "slope µs", "± 95 %", "rms µm", "fitted by")
    axes = [("", found.x)] if found.x == found.y else [("x ", found.x), ("y ", found.y)]
    for axis, of in axes:
        parts = (("lag", of.lag), ("acceleration length", of.acceleration), ("lead", of.lead))
        for name, part in parts:
            if part is None:
                continue
            figures = (
                part.intercept_um,
                part.intercept_confidence_95,
                part.slope_us,
                part.slope_confidence_95,
                part.rms_um,
            )
            by = "means at each speed" if part.means else "line"
            made.add_row(axis + name, *(f"{value:.2f}" for value in figures), by)
    print_data(made)


@galvo.command("identify")
def identify(
    trajectory: Annotated[
        Path, typer.Argument(metavar="TRAJECTORY", help="time_us,command_um,position_um.")
    ],
    output: Annotated[Path | None, option("-o", "--output", help="Head file to write.")] = None,
    family: Annotated[
        str, option("--family", help="best, bessel, second-order or acceleration-time.")
    ] = "best",
    as_json: JsonOption = False,
) -> None:
    """Fit a model of the head to a recorded trajectory."""
    found = heads.identify(trajectory, family=family)
    if output is not None:
        _write(output, found.toml)
    if as_json:
        values = {name: value for name, value, _ in found.parameters}
        widths = {f"{name}_confidence_95": width for name, _, width in found.parameters}
        report = {"family": found.family, **values, **widths, "rms_um": found.rms_um}
        print_json({**report, "version": lasergym.__version__})
        return
    made = table("parameter", "value", "± 95 %")
    for name, value, width in found.parameters:
        made.add_row(name, f"{value:.4g}", f"{width:.2g}")
    made.caption = f"{found.family}, rms {found.rms_um:.3g} µm"
    print_data(made)


@galvo.command("tune")
def tune(
    head: Annotated[
        str, typer.Argument(metavar="HEAD", help=f"The head to simulate: {_HEAD_HELP}")
    ] = "bessel",
    output: Annotated[Path | None, option("-o", "--output", help="Head file to write.")] = None,
    known: Annotated[
        str | None,
        option("--known", help="What the formulas know, with its calibration; default: the head."),
    ] = None,
    speeds_m_s: Annotated[
        str, option("--speeds-m-s", help="Speeds to tune for, m/s.")
    ] = "0.5,1,1.5,2",
    lengths_um: Annotated[
        str, option("--lengths-um", help="Lengths of the lines, µm.")
    ] = "80,400,2000",
    angles_deg: Annotated[
        str, option("--angles-deg", help="Directions of the lines, degrees.")
    ] = "0,35,90",
    beam_um: BeamOption = 40.0,
    pitch_um: Annotated[float, option("--pitch-um", help="Distance of pulses, µm.")] = 20.0,
    delays_only: Annotated[
        bool,
        option("--delays-only", help="No run-in and run-out: delays for one speed."),
    ] = False,
    evaluations: Annotated[
        int, option("--evaluations", help="Corrections to try at each speed.")
    ] = 800,
    seed: Annotated[int, option("--seed", help="Seed of the search.")] = 0,
    as_json: JsonOption = False,
) -> None:
    """Find by CMA-ES what to add to the formulas, on a simulated head; never worse than without."""
    speeds = sorted(set(_numbers("speeds_m_s", speeds_m_s)))
    if delays_only and output is not None and len(speeds) > 1:
        raise OptionError("a controller has one set of delays: give one speed with --delays-only")
    found = [
        heads.tune(
            head,
            speed_m_s=speed,
            known=known,
            lengths_um=_numbers("lengths_um", lengths_um),
            angles_deg=_numbers("angles_deg", angles_deg),
            beam_um=beam_um,
            pitch_um=pitch_um,
            delays_only=delays_only,
            evaluations=evaluations,
            seed=seed,
        )
        for speed in speeds
    ]
    if output is not None:
        text = heads.head_text(head if known is None else known)
        if delays_only:
            added = found[0].delays_toml
            text = _without("controller.delays", text)
        else:
            added = "".join(of.toml for of in found)
            text = _without("correction", text)
        _write(output, text + added)
    if as_json:
        rows = [asdict(of) for of in found]
        print_json({"head": head, "speeds": rows, "version": lasergym.__version__})
        return
    made = table("m/s", "run-in µm", "run-out µm", "on µs", "off µs", "cost", "of the formulas")
    for of in found:
        figures = (of.run_in_um, of.run_out_um, of.on_us, of.off_us)
        made.add_row(
            f"{of.speed_m_s:g}",
            *(f"{value:.1f}" for value in figures),
            f"{of.cost:.3f}",
            f"{of.formula_cost:.3f}",
        )
    print_data(made)


@galvo.command("postprocess")
@galvo.command("post", hidden=True)
def postprocess(
    job: Annotated[
        Path,
        typer.Argument(
            metavar="JOB",
            help="A .apt, .cl, .cls, .nc, .gcode or .ngc file, or a .csv of passes or pulses.",
        ),
    ],
    output: Annotated[Path, option("-o", "--output", help="The program to write.")],
    head: HeadOption = "bessel",
    speed_m_s: Annotated[
        float | None, option("--speed-m-s", help="Speed; default: that of the job, m/s.")
    ] = None,
    beam_um: BeamOption = 40.0,
    pitch_um: Annotated[
        float | None, option("--pitch-um", help="Distance of pulses; default: the head's rate.")
    ] = None,
    dialect: Annotated[
        str | None,
        option(
            "--dialect",
            help="grbl, linuxcnc, mach4, rtc or rtc-micro-vectors; default by the ending.",
        ),
    ] = None,
    step_us: Annotated[
        int, option("--step-us", help="Time between micro-vectors, a multiple of 10 µs.")
    ] = 10,
    origin_um: Annotated[
        str, option("--origin-um", help="Where the job's origin lies in the field, x,y in µm.")
    ] = "0,0",
    method: Annotated[
        str, option("--method", help="adaptive, delays (no offsets) or none.")
    ] = "adaptive",
    control: Annotated[
        str, option("--control", help="delays (of the controller) or inline (in the program).")
    ] = "delays",
    grid: Annotated[
        str, option("--grid", help="fit the pulse rate to each stroke, or keep it.")
    ] = "fit",
    tolerance: Annotated[
        float, option("--tolerance", help="Part by which pulse distances may vary.")
    ] = 0.02,
    corner_deg: Annotated[
        float, option("--corner-deg", help="Larger turns break strokes, degrees.")
    ] = 10.0,
    jump_delay_us: Annotated[
        float | None, option("--jump-delay-us", help="Wait after jumps, µs.")
    ] = None,
    mark_delay_us: Annotated[
        float | None, option("--mark-delay-us", help="Wait after strokes, µs.")
    ] = None,
    power: Annotated[float, option("--power", help="S (or Q) of lit vectors.")] = 255.0,
    as_json: JsonOption = False,
) -> None:
    """Turn a job into a program whose lines come out as drawn, with pulses equally far apart."""
    started_s = time.perf_counter()
    if output.resolve() == job.resolve():
        raise OptionError("the output is the job itself: give another name")
    chosen = dialect or ("rtc" if output.suffix.lower() == ".csv" else "grbl")
    vectors = heads.postprocess(
        job,
        output,
        head=head,
        dialect=chosen,
        method=cast("heads.Method", method),
        speed_m_s=speed_m_s,
        beam_um=beam_um,
        pitch_um=pitch_um,
        tolerance=tolerance,
        corner_deg=corner_deg,
        control=cast("Literal['delays', 'inline']", control),
        grid=cast("Literal['fit', 'keep']", grid),
        jump_delay_us=jump_delay_us,
        mark_delay_us=mark_delay_us,
        power=power,
        step_us=step_us,
        origin_um=_place(origin_um),
    )
    report = {
        "job": str(job),
        "program": str(output),
        "dialect": chosen,
        "vectors": vectors,
        "elapsed_s": time.perf_counter() - started_s,
        "version": lasergym.__version__,
    }
    if as_json:
        print_json(report)
    else:
        note(f"wrote {output}")
        print_data(f"{vectors} vectors in {report['elapsed_s']:.2f} s")


@galvo.command("simulate")
def simulate(
    program: Annotated[
        Path,
        typer.Argument(metavar="PROGRAM", help="G-code, ours or foreign, or an RTC list, .csv."),
    ],
    head: HeadOption = "bessel",
    output: Annotated[
        Path | None, option("-o", "--output", help="Folder for energy map, strokes and report.")
    ] = None,
    map_px: Annotated[
        int, option("--map-px", help="Cells of the energy map along its longer side.")
    ] = 800,
    as_json: JsonOption = False,
) -> None:
    """Run a program on a simulated head: lengths, pulse distances, corners, time, energy map."""
    if output is not None and output.exists() and not output.is_dir():
        raise OptionError(f"output is {output}, which is a file: give the name of a folder")
    started_s = time.perf_counter()
    judged = heads.simulate(program, head=head, map_px=None if output is None else map_px)
    report = {
        "program": str(program),
        "head": head,
        **judged.as_dict(),
        "elapsed_s": time.perf_counter() - started_s,
        "version": lasergym.__version__,
    }
    if output is not None:
        _write_folder(output, judged, report)
    if as_json:
        print_json(report)
        return
    made = table("figure", "value")
    for name, value in judged.figures.items():
        made.add_row(name, "–" if value is None else f"{value:.6g}")
    print_data(made)


def _numbers(name: str, text: str) -> list[float]:
    """The numbers of an option that has several."""
    try:
        return [float(number) for number in text.split(",")]
    except ValueError as error:
        raise OptionError(f"{name} is {text!r}, but must be numbers with commas") from error


def _place(text: str) -> tuple[float, float]:
    """The place that an option names."""
    numbers = _numbers("origin_um", text)
    if len(numbers) != 2:
        raise OptionError(f"origin_um is {text!r}, but must be x,y")
    return numbers[0], numbers[1]


def _write(output: Path | None, text: str) -> None:
    if output is None:
        print_data(text.rstrip("\n"))
        return
    output.write_text(text, encoding="utf-8")
    note(f"wrote {output}")


def _write_folder(folder: Path, judged: heads.Judgement, report: dict[str, Any]) -> None:
    import json

    import numpy as np

    folder.mkdir(parents=True, exist_ok=True)
    names = ["strokes.csv", "report.json"]
    columns = judged.strokes.dtype.names or ()
    rows = np.array([judged.strokes[name] for name in columns]).T
    np.savetxt(
        folder / "strokes.csv", rows, "%.6g", delimiter=",", header=",".join(columns), comments=""
    )
    if judged.picture is not None:
        (folder / "energy.png").write_bytes(judged.picture)
        names.append("energy.png")
    text = json.dumps(report, indent=2) + "\n"
    (folder / "report.json").write_text(text, encoding="utf-8")
    for name in names:
        note(f"wrote {folder / name}")


def _without(section: str, text: str) -> str:
    """A head file without the sections whose names begin so."""
    kept: list[str] = []
    keeps = True
    for line in text.splitlines(keepends=True):
        if line.lstrip().startswith("["):
            keeps = not line.lstrip(" \t[").startswith(section)
        if keeps:
            kept.append(line)
    return "".join(kept).rstrip("\n") + "\n"
