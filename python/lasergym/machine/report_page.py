"""The report of a job as one HTML page that needs nothing else."""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Mapping
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from lasergym import _native
from lasergym.errors import JobError
from lasergym.machine.journal import Mark

if TYPE_CHECKING:
    from lasergym.machine.report import JobReport, Step

__all__ = ["report_page"]

_TEMPLATE = "report_template.html"
_TRAJECTORY_WIDTH_PX = 480

_PHASES = {
    "move_s": "stage moves",
    "settle_s": "stage settles",
    "camera_s": "camera",
    "vision_s": "vision",
    "decide_s": "decision",
    "journal_s": "journal",
    "fire_s": "laser",
}
"""Phases in the order of the loop, and what the page calls them."""


def report_page(report: JobReport) -> str:
    """The page: its figures and pictures come from the journal and the native process."""
    title = f"Job {report.folder.resolve().name}"
    data = {
        "steps": _steps(report),
        "frames": _frames(report),
        "matrix": _frame_matrix(report.begin.calibration),
        "phases": _phases(report.phases),
        "faults": [
            {"fault": fault.fault, "device": fault.device, "message": fault.message}
            for fault in report.faults
        ],
        "facts": _facts(report),
        "curves": _curves(report),
    }
    # A "<" in JSON is always inside a string: written so, no text can end the script element.
    written = json.dumps(data, ensure_ascii=False, separators=(",", ":")).replace("<", "\\u003c")
    page = files(__package__).joinpath(_TEMPLATE).read_text(encoding="utf-8")
    return page.replace("{{title}}", html.escape(title)).replace("{{data}}", written)


def _steps(report: JobReport) -> list[dict[str, Any]]:
    """The states of the slider: before the first pulse, and after each."""
    states = [_state(report, 0, None, (0.0, 0.0, 0.0), (None, report.first_frame))]
    figures = (0.0, 0.0, 0.0)
    before = report.first_frame
    for number, step in enumerate(report.steps, start=1):
        seen = step.observed
        if seen is not None:
            figures = (seen.reward, seen.machined_fraction, seen.off_target_fraction)
        states.append(_state(report, number, step, figures, (before, step.frame)))
        before = step.frame or before
    return states


def _state(
    report: JobReport,
    number: int,
    step: Step | None,
    figures: tuple[float, float, float],
    frames: tuple[str | None, str | None],
) -> dict[str, Any]:
    reward, machined_fraction, off_target_fraction = figures
    picture = _native.TrajectoryPicture(
        report.begin.target,
        report.trajectory(number),
        _TRAJECTORY_WIDTH_PX,
        False,
        True,
        None,
    )
    seen = None if step is None else step.observed
    return {
        "pulse": 0 if step is None else step.pulse,
        "svg": picture.svg(),
        "reward": f"{reward:.4f}",
        "machined": f"{machined_fraction:.2%}",
        "off_target": f"{off_target_fraction:.2%}",
        "before": frames[0],
        "after": frames[1],
        "aim": None if step is None else [*step.aimed_px, report.begin.pulse_radius_px],
        "marks": [] if seen is None else [_circle(mark) for mark in seen.marks],
        "shift": [0.0, 0.0] if seen is None else list(seen.shift_px),
        "verdict": "" if step is None else ("not observed" if seen is None else seen.verdict),
        "said": "before the first pulse" if step is None else _said(step),
    }


def _circle(mark: Mark) -> list[float]:
    return [round(value, 3) for value in (mark.x_px, mark.y_px, mark.radius_px)]


def _said(step: Step) -> str:
    """A pulse in words."""
    x_px, y_px = step.aimed_px
    parts = [f"aimed at ({x_px:.1f}, {y_px:.1f}) µm"]
    if step.observed is None:
        return f"{parts[0]}, outcome not observed"
    parts += [
        f"mark at ({mark.x_px:.1f}, {mark.y_px:.1f}) µm, radius {mark.radius_px:.2f} µm, "
        f"confidence {mark.confidence:.2f}"
        for mark in step.observed.marks
    ]
    if not step.observed.marks:
        parts.append("no mark")
    if step.error_px is not None:
        parts.append(f"{step.error_px:.2f} µm from the aim")
    if step.observed.looks > 1:
        parts.append(f"{step.observed.looks} looks")
    return ", ".join(parts)


def _frames(report: JobReport) -> dict[str, Any]:
    """Previews of the frames as data URLs; the page shows them in the sides that they have.

    Frames that are missing or damaged are left out.
    """
    previews = {}
    for name in (report.first_frame, *(step.frame for step in report.steps)):
        if name is None or not (report.folder / name).is_file():
            continue
        try:
            jpeg, width_px, height_px = _native.frame_preview(
                (report.folder / name).read_bytes(), name
            )
        except JobError:
            continue
        url = "data:image/jpeg;base64," + base64.b64encode(jpeg).decode()
        previews[name] = {"url": url, "width": width_px, "height": height_px}
    return previews


def _frame_matrix(calibration: Mapping[str, Any] | None) -> list[float]:
    """The map from pattern to frame as SVG's ``matrix`` takes it, column by column."""
    if calibration is None or "frame_from_pattern" not in calibration:
        return [1.0, 0.0, 0.0, 1.0, 0.0, 0.0]
    x_row, y_row = calibration["frame_from_pattern"]
    return [float(row[column]) for column in range(3) for row in (x_row, y_row)]


def _phases(phases: Mapping[str, float]) -> list[dict[str, str | float]]:
    total_s = sum(phases.values())
    names = [*(name for name in _PHASES if name in phases), *(set(phases) - set(_PHASES))]
    return [
        {
            "name": _PHASES.get(name, name.removesuffix("_s")),
            "time": _time(phases[name]),
            "share": f"{phases[name] / total_s:.1%}",
            "percent": round(100 * phases[name] / total_s, 3),
        }
        for name in names
        if total_s > 0
    ]


def _time(time_s: float) -> str:
    return f"{time_s * 1e3:.1f} ms" if time_s < 1 else f"{time_s:.2f} s"


def _curves(report: JobReport) -> dict[str, str]:
    """Machined and off-target fraction over the pulses, as points in a box of 100 × 100."""
    states = [(0.0, 0.0)]
    for step in report.steps:
        seen = step.observed
        states.append(
            states[-1] if seen is None else (seen.machined_fraction, seen.off_target_fraction)
        )
    last = max(len(states) - 1, 1)
    names = ("machined", "off_target")
    return {
        name: " ".join(
            f"{100 * k / last:.2f},{100 - 100 * min(state[which], 1.0):.2f}"
            for k, state in enumerate(states)
        )
        for which, name in enumerate(names)
    }


def _facts(report: JobReport) -> list[list[str]]:
    begin = report.begin
    facts = [
        ["status", report.status.replace("_", " ")],
        ["pulses", f"{report.pulses} of at most {begin.max_pulses}"],
        ["target", f"{int(begin.target.sum())} µm²"],
        ["time", _time(report.elapsed_s)],
        ["resumed", f"{report.resumed} times" if report.resumed != 1 else "once"],
        ["planner", _words(begin.planner)],
        ["drivers", _words(begin.drivers)],
        ["seed", str(begin.seed)],
    ]
    if begin.dry_run:
        facts.insert(1, ["dry run", "the laser was never armed"])
    if report.damage is not None:
        facts.insert(1, ["journal", f"damaged: {report.damage}; what follows is not shown"])
    return [fact for fact in facts if fact[1]]


def _words(settings: Mapping[str, Any]) -> str:
    """Settings in a line, the name first."""
    plain = {key: value for key, value in settings.items() if not isinstance(value, Mapping | list)}
    names = [str(plain.pop(key)) for key in ("name", "preset") if key in plain]
    return ", ".join([*names, *(f"{key} {value}" for key, value in plain.items())])
