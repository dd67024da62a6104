"""Pictures of a comparison: by angle, by area class, and cost against quality."""

from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from lasergym.comparison.columns import column_of
from lasergym.comparison.statistics import MEASURES, summarise
from lasergym.comparison.tasks import (
    AREA_CLASSES_PX,
    RANDOM_SHAPES,
    ROTATED_STAR,
    area_class_px,
)
from lasergym.comparison.work import Row
from lasergym.errors import MissingExtraError

__all__ = ["draw_figures", "import_matplotlib", "require_matplotlib"]

_COLOURS = {
    "raster": "#E69F00",
    "raster-fine": "#56B4E9",
    "greedy": "#009E73",
    "anneal": "#D55E00",
    "cma-es": "#0072B2",
    "policy": "#CC79A7",
}
"""Okabe and Ito's palette, which colour-blind people can tell apart."""

_MARKERS = {
    "raster": "s",
    "raster-fine": "D",
    "greedy": "^",
    "anneal": "o",
    "cma-es": "v",
    "policy": "P",
}
_LINES = {"raster": ":", "raster-fine": (0, (4, 1.5)), "cma-es": (0, (6, 1))}

_STYLE: dict[str, Any] = {
    "font.size": 8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#d9dce0",
    "grid.linewidth": 0.5,
    "legend.frameon": False,
    "lines.linewidth": 1.2,
    "svg.hashsalt": "lasergym",
}
_WIDTH_IN = 7.2
"""Width over both columns of a journal page, inches."""

_DPI = 300
_SHORTEST_S = 1e-7
"""Less cannot be drawn on a logarithmic axis, s."""

_LABEL_FACTOR = 100.0
"""Markers nearer to each other than this factor of time leave no room for two labels between."""

_NEAR_BEST = 0.95
"""Planners with this share of the best mean reward are drawn enlarged."""

_MEASURES = {measure.name: measure for measure in MEASURES}


def require_matplotlib() -> None:
    """Checks that pictures can be drawn.

    Raises:
        MissingExtraError: Matplotlib is not installed.
    """
    import_matplotlib("matplotlib.figure")


def draw_figures(folder: Path, rows: Sequence[Row], planners: Sequence[str]) -> list[Path]:
    """Draws what the results allow, as PNG and SVG.

    Args:
        folder: Where the pictures go.
        rows: Results.
        planners: Planners in the order of the legend.

    Returns:
        The files.
    """
    files: list[Path] = []
    with import_matplotlib("matplotlib").rc_context(_STYLE):
        stars = [row for row in rows if row.task == ROTATED_STAR]
        if stars:
            files += _save(folder / "rotated_star", _by_angle(stars, planners))
        shapes = [row for row in rows if row.task == RANDOM_SHAPES]
        if shapes:
            files += _save(folder / "area_classes", _by_area_class(shapes, planners))
        files += _save(folder / "cost_quality", _cost_quality(rows, planners))
    return files


def _save(stem: Path, figure: Any) -> list[Path]:
    """Writes a figure as ``.png`` and ``.svg``; the same figure gives the same bytes."""
    files = [stem.with_suffix(ending) for ending in (".png", ".svg")]
    figure.savefig(files[0], dpi=_DPI)
    figure.savefig(files[1], metadata={"Date": None})
    return files


def _by_angle(rows: Sequence[Row], planners: Sequence[str]) -> Any:
    """Xie et al. (2022), Fig. 4 b: degree by degree, with the reward on top.

    Where some planners are far below the best, a second panel shows the reward of the others.
    """
    best = _near_best(rows, planners)
    panels = [("reward", tuple(planners), 2.0)]
    if 0 < len(best) < len(planners):
        panels.append(("reward", best, 2.0))
    panels += [("machined_percent", tuple(planners), 1.6)]
    panels += [("off_target_percent", tuple(planners), 1.6)]
    heights_in = [height_in for _, _, height_in in panels]
    figure = _new_figure(_WIDTH_IN, sum(heights_in) + 0.7)
    axes = figure.subplots(len(panels), 1, sharex=True, height_ratios=heights_in)
    for axis, (name, drawn, _) in zip(axes, panels, strict=True):
        measure = _MEASURES[name]
        for planner in drawn:
            points = sorted(
                (float(row.target.partition(":")[2]), measure.value(row))
                for row in rows
                if row.planner == planner
            )
            axis.plot(
                [angle_deg for angle_deg, _ in points],
                [value for _, value in points],
                color=_colour(planner),
                linestyle=_LINES.get(planner, "-"),
                marker=_MARKERS.get(planner, "o") if len(points) < 40 else None,
                markersize=3,
                linewidth=1.2 if len(points) < 40 else 0.8,
                label=column_of(planner).title,
            )
        axis.set_ylabel(measure.title if len(drawn) == len(planners) else "total reward, enlarged")
        if name == "off_target_percent":
            _stretch_small_percentages(axis)
    figure.align_ylabels(axes)
    axes[-1].set_xlabel("angle of the star, degrees")
    axes[-1].set_xlim(0, 360)
    axes[-1].set_xticks(range(0, 361, 36))
    _legend_above(figure, axes[0], planners)
    return figure


def _by_area_class(rows: Sequence[Row], planners: Sequence[str]) -> Any:
    """Xie et al. (2022), Fig. 6 b: box plots by area class."""
    figure = _new_figure(_WIDTH_IN, 5.2)
    axes = figure.subplots(2, 1, sharex=True)
    width = 0.8 / len(planners)
    for axis, name in zip(axes, ("machined_percent", "off_target_percent"), strict=True):
        measure = _MEASURES[name]
        for index, planner in enumerate(planners):
            colour = _colour(planner)
            boxes = axis.boxplot(
                [_values(rows, planner, bounds_px, measure.value) for bounds_px in AREA_CLASSES_PX],
                positions=[
                    place + (index - (len(planners) - 1) / 2) * width
                    for place in range(len(AREA_CLASSES_PX))
                ],
                widths=0.8 * width,
                patch_artist=True,
                manage_ticks=False,
                boxprops={"facecolor": colour + "66", "edgecolor": colour, "linewidth": 0.8},
                medianprops={"color": "#24292f", "linewidth": 1.0},
                whiskerprops={"color": colour, "linewidth": 0.8},
                capprops={"color": colour, "linewidth": 0.8},
                flierprops={
                    "marker": ".",
                    "markersize": 4,
                    "markerfacecolor": colour,
                    "markeredgecolor": "none",
                },
            )
            boxes["boxes"][0].set_label(column_of(planner).title)
        axis.set_ylabel(measure.title)
        if name == "off_target_percent":
            _stretch_small_percentages(axis)
        axis.grid(axis="x", visible=False)
        for edge in range(1, len(AREA_CLASSES_PX)):
            axis.axvline(edge - 0.5, color="#d9dce0", linewidth=0.5)
    figure.align_ylabels(axes)
    axes[-1].set_xticks(
        range(len(AREA_CLASSES_PX)), [f"{least}–{below}" for least, below in AREA_CLASSES_PX]
    )
    axes[-1].set_xlim(-0.5, len(AREA_CLASSES_PX) - 0.5)
    axes[-1].set_xlabel("area of the target, px")
    _legend_above(figure, axes[0], planners)
    return figure


def _cost_quality(rows: Sequence[Row], planners: Sequence[str]) -> Any:
    """Seconds per target against reward / area: a panel for each task."""
    tasks = list(dict.fromkeys(row.task for row in rows))
    columns = 2 if len(tasks) == 4 else min(3, len(tasks))
    lines = -(-len(tasks) // columns)
    width_in = _WIDTH_IN if columns > 1 else 4.6
    figure = _new_figure(width_in, 0.5 + 2.9 * lines)
    panels = figure.subplots(lines, columns, sharex=True, sharey=True, squeeze=False).ravel()
    for index, panel in enumerate(panels):
        panel.set_visible(index < len(tasks))
    for panel, task in zip(panels, tasks, strict=False):
        points = []
        for planner in planners:
            done = [row for row in rows if row.task == task and row.planner == planner]
            if done:
                cost_s = max(summarise([row.elapsed_s for row in done]).mean, _SHORTEST_S)
                points.append((cost_s, planner, summarise([row.reward_per_area for row in done])))
        cheaper_s = 0.0
        for cost_s, planner, quality in sorted(points, key=lambda point: point[0]):
            panel.errorbar(
                cost_s,
                quality.mean,
                yerr=quality.spread or None,
                color=_colour(planner),
                marker=_MARKERS.get(planner, "o"),
                linestyle="none",
                markersize=6,
                markeredgecolor="white",
                markeredgewidth=0.6,
                elinewidth=1.0,
                capsize=2.5,
                label=column_of(planner).title,
            )
            # On the left, unless a cheaper planner's marker is there.
            right = cost_s < _LABEL_FACTOR * cheaper_s
            panel.annotate(
                f"{quality.mean:.4f}",
                (cost_s, quality.mean),
                xytext=(6 if right else -6, 0),
                textcoords="offset points",
                ha="left" if right else "right",
                va="center",
                fontsize=7,
            )
            cheaper_s = cost_s
        panel.set_xscale("log")
        panel.margins(x=0.25)
        number = len({row.target for row in rows if row.task == task})
        panel.set_title(f"{task} ({number})", fontsize=8, loc="left")
    figure.supxlabel("seconds per target (one thread)", fontsize=8)
    figure.supylabel("reward · 10⁴ / area, mean ± standard deviation", fontsize=8)
    _legend_above(figure, panels[0], planners)
    return figure


def _near_best(rows: Sequence[Row], planners: Sequence[str]) -> tuple[str, ...]:
    """The planners whose mean reward comes close to the highest."""
    means = {
        planner: summarise([row.reward for row in rows if row.planner == planner]).mean
        for planner in planners
    }
    return tuple(name for name in planners if means[name] >= _NEAR_BEST * max(means.values()))


def _stretch_small_percentages(axis: Any) -> None:
    """An axis that is linear up to 1 % and logarithmic above."""
    axis.set_yscale("symlog", linthresh=1.0)
    ticks = (0, 0.5, 1, 2, 5, 10, 20, 50, 100)
    highest = next((tick for tick in ticks if tick >= axis.get_ylim()[1]), ticks[-1])
    axis.set_ylim(0, highest)
    axis.set_yticks([tick for tick in ticks if tick <= highest])
    axis.yaxis.set_major_formatter("{x:g}")
    axis.yaxis.set_minor_locator(import_matplotlib("matplotlib.ticker").NullLocator())


def _values(
    rows: Sequence[Row],
    planner: str,
    bounds_px: tuple[int, int],
    value: Callable[[Row], float],
) -> list[float]:
    return [
        value(row)
        for row in rows
        if row.planner == planner and area_class_px(row.area_px) == bounds_px
    ]


def _colour(planner: str) -> str:
    return _COLOURS.get(planner, "#555555")


def _legend_above(figure: Any, axis: Any, planners: Sequence[str]) -> None:
    """One line of planners in the order of the table."""
    handles, labels = axis.get_legend_handles_labels()
    titles = [column_of(planner).title for planner in planners]
    pairs = sorted(zip(handles, labels, strict=True), key=lambda pair: titles.index(pair[1]))
    figure.legend(
        [handle for handle, _ in pairs],
        [label for _, label in pairs],
        loc="outside upper center",
        ncols=len(titles),
    )


def _new_figure(width_in: float, height_in: float) -> Any:
    figure = import_matplotlib("matplotlib.figure").Figure
    return figure(figsize=(width_in, height_in), layout="constrained")


def import_matplotlib(module: str) -> Any:
    """A module of Matplotlib, which is imported when a picture is drawn and not before.

    Raises:
        MissingExtraError: Matplotlib is not installed.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise MissingExtraError(
            "pictures need Matplotlib: pip install 'lasergym[plots]', or leave them out "
            "(--no-pictures)"
        ) from error
