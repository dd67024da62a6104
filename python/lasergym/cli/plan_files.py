"""The files that a plan is written to; the ending of the name chooses what is in them."""

import json
from collections.abc import Sequence
from pathlib import Path

from lasergym import programs
from lasergym.cli.plan_report import PlanReport
from lasergym.errors import OptionError
from lasergym.programs import GcodeOptions
from lasergym.render import render_trajectory
from lasergym.targets import Target

__all__ = ["check_files", "write_file"]

_ENDINGS = (".csv", ".nc", ".gcode", ".svg", ".png", ".json")


def check_files(paths: Sequence[Path]) -> None:
    """Refuses, before any work is done, what could not be written at its end.

    Raises:
        OptionError: An ending is not known, a folder is missing, or a file is named twice.
    """
    for path in paths:
        if path.suffix.lower() not in _ENDINGS:
            accepted = ", ".join(_ENDINGS)
            raise OptionError(f"{path} must end in one of {accepted}")
        if not path.parent.is_dir():
            raise OptionError(f"the folder of {path} does not exist: make it first")
        if path.is_dir():
            raise OptionError(f"{path} is a folder: give the name of a file")
        if paths.count(path) > 1:
            raise OptionError(f"{path} is given twice")


def write_file(path: Path, report: PlanReport, target: Target, *, gcode: GcodeOptions) -> None:
    """Writes the plan of a report.

    Args:
        path: ``.csv`` positions in µm, ``.nc`` or ``.gcode`` a GRBL program, ``.svg`` or ``.png`` a
            picture, ``.json`` the report.
        report: The plan and its figures.
        target: Boolean array of shape (100, 100).
        gcode: Frame, power and times of the program.
    """
    plan = report.plan
    ending = path.suffix.lower()
    if ending == ".csv":
        text = programs.to_csv(plan.xy_px * report.pixel_um)
    elif ending in (".nc", ".gcode"):
        text = programs.to_gcode(plan.xy_px, pulse_radius_px=plan.pulse_radius_px, options=gcode)
    elif ending == ".json":
        text = json.dumps(report.as_dict(), indent=2) + "\n"
    else:
        render_trajectory(target, plan, path, caption=_caption(report))
        return
    path.write_text(text, encoding="utf-8")


def _caption(report: PlanReport) -> str:
    plan = report.plan
    return (
        f"{plan.planner}: {plan.pulses} pulses, {plan.machined_fraction:.1%} machined, "
        f"{plan.off_target_fraction:.1%} off"
    )
