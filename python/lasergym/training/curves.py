"""The training curve: returns against steps, with the planners as lines."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lasergym.comparison.columns import column_of
from lasergym.comparison.figures import import_matplotlib
from lasergym.training.history import Evaluated, Updated

__all__ = ["draw_curve"]

_AGENT = "#CC79A7"
_COLOURS = {"greedy": "#009E73", "anneal": "#D55E00", "cma-es": "#0072B2"}
_LINES = {"greedy": ":", "anneal": "-.", "cma-es": "--"}
_POINTS = 400
"""Most points of the curve; more are averaged."""


def draw_curve(
    path: Path,
    title: str,
    updated: Sequence[Updated],
    evaluated: Sequence[Evaluated],
    planners: Mapping[str, float],
) -> None:
    """Draws a training curve as PNG.

    Args:
        path: The file.
        title: Its title.
        updated: Returns of the agent as it acts in training.
        evaluated: Returns without exploration on held-out targets.
        planners: Mean reward of each planner on the same targets.

    Raises:
        MissingExtraError: Matplotlib is not installed.
    """
    matplotlib = import_matplotlib("matplotlib")
    figure_class = import_matplotlib("matplotlib.figure").Figure
    with matplotlib.rc_context({"font.size": 8, "axes.grid": True, "grid.color": "#d9dce0"}):
        figure = figure_class(figsize=(6.4, 3.8), layout="constrained")
        axis = figure.subplots()
        factor, unit = _unit(updated, evaluated)
        lines = [line for line in updated if not math.isnan(line.return_mean)]
        if lines:
            steps = _averaged([line.steps for line in lines]) / factor
            means = _averaged([line.return_mean for line in lines])
            axis.plot(steps, means, color=_AGENT, alpha=0.5, label="agent, in training")
        axis.plot(
            [line.steps / factor for line in evaluated],
            [line.return_mean for line in evaluated],
            color=_AGENT,
            marker="o",
            markersize=3,
            label="agent, without exploration",
        )
        for planner, reward in planners.items():
            axis.axhline(
                reward,
                color=_COLOURS.get(planner, "#555555"),
                linestyle=_LINES.get(planner, "-"),
                linewidth=1.0,
                label=column_of(planner).title,
            )
        axis.set_title(title, fontsize=8, loc="left")
        axis.set_xlabel(f"pulses ({unit})")
        axis.set_ylabel("return")
        figure.legend(frameon=False, loc="outside lower center", ncols=5)
        scratch = path.with_name(f".{path.name}")
        figure.savefig(scratch, dpi=150, format="png")
        scratch.replace(path)


def _unit(updated: Sequence[Any], evaluated: Sequence[Any]) -> tuple[float, str]:
    most = max((line.steps for line in (*updated, *evaluated)), default=0)
    return (1e6, "millions") if most >= 1e6 else (1e3, "thousands")


def _averaged(values: Sequence[float]) -> NDArray[np.float64]:
    """Means of consecutive values, so that no more than 400 are left."""
    parts = np.array_split(np.asarray(values, np.float64), min(len(values), _POINTS))
    return np.array([part.mean() for part in parts])
