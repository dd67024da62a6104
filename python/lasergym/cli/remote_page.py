"""The animation of a remote job as one HTML page that needs nothing else."""

from __future__ import annotations

import html
import json
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lasergym.remote import Plane, RemotePlan, Simulation

__all__ = ["remote_page"]

_TEMPLATE = "remote_template.html"

_STATES = 4000
"""States of the animation, at most."""


def remote_page(plan: RemotePlan, simulation: Simulation) -> str:
    """The page: robot, working field and beam over time, seen from above, and the field itself."""
    some = slice(None, None, max(1, -(-len(simulation.time_s) // _STATES)))
    data = {
        "field_radius_mm": plan.field_radius_mm,
        "total_s": simulation.total_s,
        "seams": [
            {"name": stop.name, "points": _from_above(stop.path_mm, plan.planes[stop.plane])}
            for stop in plan.stops
        ],
        "circles": [
            _circle(stop.center_mm, stop.scan_radius_mm, plan.planes[stop.plane])
            for stop in plan.stops
        ],
        "lines": [
            _from_above(np.array([line.start_mm, line.end_mm]), plan.planes[line.plane])
            for line in plan.lines
        ],
        "samples": {
            "time_s": _rounded(simulation.time_s[some], 4),
            "robot": _rounded(simulation.robot_mm[some, :2], 2),
            "beam": _rounded(simulation.beam_mm[some, :2], 2),
            "field": _rounded(simulation.field_mm[some], 2),
            "laser": simulation.laser[some].astype(int).tolist(),
        },
        "facts": [
            ["Cycle time", f"{plan.cycle_time_s:.3f} s"],
            ["Laser on", f"{plan.laser_s:.3f} s"],
            ["Robot lines", str(len(plan.lines))],
            ["Subtasks", str(len(plan.stops))],
            ["Beam beside its seam", f"at most {1e3 * simulation.max_seam_error_mm:.1f} µm"],
            ["Speed on the workpiece", f"within {100 * simulation.max_speed_error:.2f} %"],
            ["Problems", "; ".join(simulation.problems) or "none"],
        ],
    }
    # A "<" in JSON is always inside a string: written so, no text can end the script element.
    written = json.dumps(data, ensure_ascii=False, separators=(",", ":")).replace("<", "\\u003c")
    page = files(__package__).joinpath(_TEMPLATE).read_text(encoding="utf-8")
    return page.replace("{{title}}", html.escape(plan.name)).replace("{{data}}", written)


def _circle(center: tuple[float, float], radius_mm: float, plane: Plane) -> list[list[float]]:
    angles = np.linspace(0, 2 * np.pi, 49)
    rim = np.array(center) + radius_mm * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return _from_above(rim, plane)


def _from_above(points: NDArray[np.float64], plane: Plane) -> list[list[float]]:
    """Points of a plane as x and y of the robot's frame, mm."""
    a, b, c = np.radians(plane.abc_deg)
    # The first two columns of Rz(a) Ry(b) Rx(c), without the row of z.
    turn = np.array(
        [
            [np.cos(a) * np.cos(b), np.cos(a) * np.sin(b) * np.sin(c) - np.sin(a) * np.cos(c)],
            [np.sin(a) * np.cos(b), np.sin(a) * np.sin(b) * np.sin(c) + np.cos(a) * np.cos(c)],
        ]
    )
    seen: list[list[float]] = _rounded(points @ turn.T + np.array(plane.origin_mm[:2]), 2)
    return seen


def _rounded(values: NDArray[np.float64], digits: int) -> Any:
    return np.round(values, digits).tolist()
