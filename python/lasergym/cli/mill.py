"""``lasergym mill``: a depth map in, passes, pictures and a report out."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, cast

import numpy as np
import typer

import lasergym
from lasergym import milling
from lasergym.cli.mill_figures import draw_figures
from lasergym.cli.options import option
from lasergym.cli.output import note, print_data, print_json, progress_bar, table
from lasergym.errors import OptionError
from lasergym.milling import MillingResult

__all__ = ["mill"]

_TARGET = "Target"
_SOLVER = "Solver"
_MACHINE = "Machine"


def mill(
    target: Annotated[
        Path,
        typer.Argument(
            metavar="TARGET", help="Heights: a .npy, .asc, .dem, .png, .tif or .stl file."
        ),
    ],
    output: Annotated[
        Path | None,
        option("-o", "--output", help="Folder for passes, surface, pictures and report."),
    ] = None,
    process: Annotated[
        str,
        option("--process", help=f"{', '.join(milling.PROCESSES)}, or a TOML profile."),
    ] = "laser-graphite",
    pixel_um: Annotated[
        float | None, option("--pixel-um", help="Side of a pixel, µm.", panel=_TARGET)
    ] = None,
    width_mm: Annotated[
        float | None,
        option("--width-mm", help="Width instead of --pixel-um, mm.", panel=_TARGET),
    ] = None,
    depth_um: Annotated[
        float | None,
        option(
            "--depth-um",
            help="Depth between highest and lowest, µm; default: the values are depths in µm.",
            panel=_TARGET,
        ),
    ] = None,
    base_um: Annotated[
        float, option("--base-um", help="Depth of the shallowest place, µm.", panel=_TARGET)
    ] = 0.0,
    high_sinks: Annotated[
        bool, option("--high-sinks", help="The highest values are deepest.", panel=_TARGET)
    ] = False,
    layers: Annotated[
        int | None, option("--layers", help="Layers; default: as needed.", panel=_SOLVER)
    ] = None,
    iterations: Annotated[
        int, option("--iterations", help="Most iterations on straight passes.", panel=_SOLVER)
    ] = 45,
    free_iterations: Annotated[
        int,
        option("--free-iterations", help="And on free passes; 0: straight.", panel=_SOLVER),
    ] = 30,
    measured: Annotated[
        Path | None,
        option(
            "--measured",
            help="Go on from this surface (depths in µm, such as a .npy); --layers are those left.",
            panel=_SOLVER,
        ),
    ] = None,
    one_layer: Annotated[
        bool,
        option(
            "--one-layer",
            help="Write the passes of the first layer only: mill it, measure, go on.",
            panel=_MACHINE,
        ),
    ] = False,
    power: Annotated[
        float, option("--power", help="Power, as the word S of GRBL.", panel=_MACHINE)
    ] = 1000.0,
    as_json: Annotated[bool, option("--json", help="Print the report as JSON.")] = False,
) -> None:
    """Find the passes that mill a depth map with a laser or a waterjet.

    Ctrl-C ends the search and keeps the best passes so far.
    """
    if output is not None and output.exists() and not output.is_dir():
        raise OptionError(f"output is {output}, which is a file: give the name of a folder")
    if (pixel_um is None) == (width_mm is None):
        raise OptionError("give either --pixel-um or --width-mm: the size on the workpiece")
    if width_mm is not None and target.suffix.lower() == ".stl":
        raise OptionError("an STL has its own size: give --pixel-um, not --width-mm")
    heights = milling.load_heights(target, pixel_um=pixel_um or 1.0)
    side_um = pixel_um or 1e3 * cast("float", width_mm) / heights.shape[1]
    is_solid = target.suffix.lower() == ".stl"
    if depth_um is None and is_solid:
        depth_um = float(np.ptp(heights))
    if depth_um is None:
        target_um = milling.depths(heights, scale="depths") + base_um
    else:
        target_um = milling.depths(
            heights,
            depth_um=depth_um,
            base_um=base_um,
            scale="high-sinks" if high_sinks else "high-stays",
        )
    with progress_bar(f"solving ({process})") as bar:
        result = milling.solve(
            target_um,
            pixel_um=side_um,
            process=process,
            layers=layers,
            measured_um=None if measured is None else milling.load_heights(measured),
            iterations=iterations,
            free_iterations=free_iterations,
            progress=lambda fraction, error: bar.show(fraction, f"error {error:.2f} %"),
        )
    report = {
        "target": str(target),
        "process": process,
        "measured": None if measured is None else str(measured),
        **result.as_dict(),
        "version": lasergym.__version__,
    }
    if output is not None:
        write_job(output, result, report, power=power, layer=0 if one_layer else None)
    if as_json:
        print_json(report)
    else:
        print_data(_table(result))
    if result.partial:
        note("stopped early: these are the best passes so far")
        raise typer.Exit(1)


def write_job(
    folder: Path,
    result: MillingResult,
    report: dict[str, Any],
    *,
    power: float,
    layer: int | None,
) -> None:
    """Writes passes, program, surface, error map, figures and report into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    program = result.to_gcode(layer=layer, power_s=power)
    (folder / "passes.csv").write_text(result.to_csv(layer=layer), encoding="utf-8")
    (folder / "passes.nc").write_text(program, encoding="utf-8")
    np.save(folder / "surface_um.npy", result.depth_um)
    np.save(folder / "error_um.npy", result.depth_um - result.target_um)
    drawn = draw_figures(folder, result)
    text = json.dumps(report, indent=2) + "\n"
    (folder / "report.json").write_text(text, encoding="utf-8")
    written = ("passes.csv", "passes.nc", "surface_um.npy", "error_um.npy", *drawn, "report.json")
    for name in written:
        note(f"wrote {folder / name}")
    if not drawn:
        note("no pictures: pip install 'lasergym[plots]'")


def _table(result: MillingResult) -> Any:
    made = table("passes", "tracking error")
    for name, error in (
        ("pixel by pixel", result.pixel_by_pixel_error_percent),
        ("straight", result.straight_error_percent),
        ("best", result.tracking_error_percent),
    ):
        made.add_row(name, f"{error:.2f} %")
    made.caption = (
        f"{result.layers} layers, {len(result.passes.y_um)} passes, "
        f"{result.machining_time_s:.1f} s of machining, solved in {result.elapsed_s:.1f} s"
    )
    return made
