"""The picture of a remote job, in the manner of Figs. 6 to 9 of the paper; it needs matplotlib."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from lasergym.remote import RemotePlan, Simulation

__all__ = ["draw_figures"]

_SCAN = "#8fa9c4"
_SEAM = "#222222"
_IDLE = "#9a9a9a"
_LASER = "#d62728"
_MOST_LISTS = 3


def draw_figures(folder: Path, plan: RemotePlan, simulation: Simulation) -> tuple[str, ...]:
    """Draws each plane with its scan circles and lines, and the scanner's paths in its field.

    Args:
        folder: Where the PNG file goes.
        plan: The plan.
        simulation: Its simulation with samples.

    Returns:
        Names of the files; none where matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError:
        return ()

    used = sorted({stop.plane for stop in plan.stops})
    lists = min(len(plan.lines), _MOST_LISTS)
    figure = Figure(figsize=(11, 5.5 * len(used) + 3.2), layout="constrained")
    heights = [5.5] * len(used) + [3.2]
    rows: Any = figure.subfigures(len(used) + 1, 1, height_ratios=heights)
    for part, plane in zip(rows, used, strict=False):
        _draw_plane(part.subplots(), plan, plane)
    fields = rows[-1].subplots(1, lists, squeeze=False)[0]
    starts = _starts_s(plan)
    for index, axes in enumerate(fields):
        _draw_field(axes, plan, simulation, index, starts[index])
    figure.savefig(folder / "plan.png", dpi=110)
    return ("plan.png",)


def _starts_s(plan: RemotePlan) -> list[tuple[float, float]]:
    """When each line begins and ends, s, with its lead-in and lead-out."""
    now_s = 0.0
    times = []
    for line in plan.lines:
        now_s += line.approach_s
        times.append((now_s, now_s + line.whole_time_s))
        now_s += line.whole_time_s
    return times


def _draw_plane(axes: Any, plan: RemotePlan, plane: int) -> None:
    from matplotlib.patches import Circle

    for stop in plan.stops:
        if stop.plane != plane:
            continue
        axes.plot(*stop.path_mm.T, color=_SEAM, linewidth=1)
        scan = Circle(stop.center_mm, stop.scan_radius_mm, facecolor=_SCAN, alpha=0.18)
        axes.add_patch(scan)
        rim = Circle(stop.center_mm, stop.scan_radius_mm, fill=False, edgecolor=_SCAN, lw=0.8)
        axes.add_patch(rim)
    before = None
    crowded = len(plan.stops) > 60
    for number, line in enumerate(plan.lines, start=1):
        if line.plane != plane:
            before = None
            continue
        if before is not None:
            axes.plot(*np.transpose([before, line.start_mm]), color=_IDLE, lw=0.8, ls=":")
        axes.plot(*np.transpose([line.start_mm, line.end_mm]), color=_IDLE, lw=1.6)
        for begin, end in line.sections_mm:
            on = [line.place_mm(begin), line.place_mm(end)]
            axes.plot(*np.transpose(on), color=_LASER, lw=3, solid_capstyle="butt")
        # The arrow stands on the line, so that a line of one section has one too.
        middle = line.place_mm(0.5 * line.length_mm)
        ahead = line.place_mm(0.5 * line.length_mm + 1.0)
        axes.annotate("", ahead, middle, arrowprops={"arrowstyle": "-|>", "color": "black"})
        if not crowded:
            axes.annotate(
                str(number), line.start_mm, textcoords="offset points", xytext=(-10, 6), fontsize=9
            )
        before = line.end_mm
    axes.plot([], [], color=_SEAM, lw=1, label="seam")
    axes.plot([], [], color=_SCAN, lw=1, label="scan circle")
    axes.plot([], [], color=_LASER, lw=3, label="laser on")
    axes.plot([], [], color=_IDLE, lw=1.6, label="robot, laser off")
    axes.plot([], [], color=_IDLE, lw=0.8, ls=":", label="PTP")
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8, frameon=False)
    title = f"{plan.name}, {plan.planes[plane].name}: {plan.cycle_time_s:.3f} s in all"
    axes.set(title=title, xlabel="x, mm", ylabel="y, mm", aspect="equal")
    axes.autoscale_view()
    axes.margins(0.05)


def _draw_field(
    axes: Any, plan: RemotePlan, simulation: Simulation, index: int, when: tuple[float, float]
) -> None:
    from matplotlib.patches import Circle

    during = (simulation.time_s >= when[0]) & (simulation.time_s <= when[1])
    on = during & simulation.laser
    axes.add_patch(Circle((0, 0), plan.field_radius_mm, fill=False, edgecolor=_SCAN))
    shown = np.where(on[:, None], simulation.field_mm, np.nan)[during]
    axes.plot(*simulation.field_mm[during].T, color=_IDLE, lw=0.4, alpha=0.6)
    axes.plot(*shown.T, color=_LASER, lw=0.4)
    limit = 1.08 * plan.field_radius_mm
    axes.set(title=f"scanner on line {index + 1}", aspect="equal")
    axes.set(xlim=(-limit, limit), ylim=(-limit, limit), xlabel="x in the field, mm")
