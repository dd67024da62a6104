"""Trajectories of all planners side by side, as in Xie et al. (2022), Fig. 7."""

import re
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from lasergym import _native
from lasergym.comparison.columns import PlannerColumn, column_of
from lasergym.comparison.figures import import_matplotlib
from lasergym.comparison.tasks import (
    AREA_CLASSES_PX,
    RANDOM_SHAPES,
    ROTATED_STAR,
    TaskTarget,
    area_class_px,
)
from lasergym.comparison.work import PULSE_RADIUS_PX, Row
from lasergym.errors import OptionError
from lasergym.planners import shortest_order

__all__ = ["choose_targets", "draw_trajectories"]

_DRAWINGS = 6
"""Most drawings of a folder that are shown unasked."""

_CELL_IN = 1.42
_LABEL_IN = 0.2
_CAPTION_IN = 0.34
_TITLE_IN = 0.22
_POINTS = 72
"""Points in an inch."""
_PICTURE_PX = 426
"""Width of a picture in the PNG; with :data:`_CELL_IN` about 300 dots per inch."""

_INK = "#24292f"


def choose_targets(targets: Sequence[TaskTarget], shown: Sequence[str]) -> list[TaskTarget]:
    """The targets whose trajectories are drawn.

    Args:
        targets: All targets of the comparison.
        shown: Names of targets; empty chooses the star, a turned one, random shapes of the least,
            the middle and the largest area class, and the first six drawings of each folder.

    Raises:
        OptionError: There is no target of that name.
    """
    if shown:
        for name in shown:
            if all(name != made.name for made in targets):
                example = (
                    f": names are like {targets[0].name}" if targets else " that has a picture"
                )
                raise OptionError(f"no target is named {name!r}{example}")
        return [made for made in targets if made.name in shown]
    chosen: list[TaskTarget] = []
    for task in dict.fromkeys(made.task for made in targets):
        members = [made for made in targets if made.task == task]
        if task == ROTATED_STAR:
            chosen.append(members[len(members) // 20])
        elif task == RANDOM_SHAPES:
            chosen += [
                next(made for made in members if area_class_px(made.area_px) == bounds_px)
                for bounds_px in AREA_CLASSES_PX[:: len(AREA_CLASSES_PX) // 2]
            ]
        else:
            chosen += members[:_DRAWINGS]
    return chosen


def draw_trajectories(
    folder: Path, chosen: Sequence[TaskTarget], rows: Sequence[Row], planners: Sequence[str]
) -> list[Path]:
    """Draws a picture for each task, with a line for each target and a column for each planner.

    Where the order of the pulses does not matter, they are joined by the way of shortest travel.

    Args:
        folder: Where the pictures go.
        chosen: Targets from top to bottom.
        rows: Results.
        planners: Planners from left to right.

    Returns:
        The files, ``.png`` and ``.svg`` of each task.
    """
    found = {row.key: row for row in rows}
    files: list[Path] = []
    for task in dict.fromkeys(made.task for made in chosen):
        grid = [
            [
                _Cell(made, found[made.task, made.name, planner], column_of(planner))
                for planner in planners
            ]
            for made in chosen
            if made.task == task
        ]
        stem = f"trajectories_{task.replace('-', '_').replace(':', '_')}"
        files += [folder / f"{stem}.png", folder / f"{stem}.svg"]
        _write_png(files[-2], grid)
        files[-1].write_text(_svg(grid), encoding="utf-8")
    return files


class _Cell:
    """One planner on one target."""

    def __init__(self, made: TaskTarget, row: Row, column: PlannerColumn) -> None:
        self.label = made.name
        self.title = column.title
        self.captions = (
            f"{row.pulses} pulses, reward {row.reward:.4f}",
            f"{row.machined_fraction:.2%} on, {row.off_target_fraction:.2%} off target",
        )
        radius_px = np.full((row.pulses, 1), PULSE_RADIUS_PX)
        xy_px = np.array(row.xy_px, dtype=np.float64).reshape(-1, 2)
        if not column.in_order:
            xy_px = xy_px[shortest_order(xy_px)]
        pulses = np.hstack([xy_px, radius_px])
        self.picture = _native.TrajectoryPicture(
            made.target > 0, pulses, _PICTURE_PX, False, False, None
        )


def _write_png(path: Path, grid: Sequence[Sequence[_Cell]]) -> None:
    matplotlib: Any = import_matplotlib("matplotlib")
    figure_class: Any = import_matplotlib("matplotlib.figure").Figure
    width_in, height_in = _size_in(grid)
    with matplotlib.rc_context({"font.size": 6, "text.color": _INK}):
        figure = figure_class(figsize=(width_in, height_in))
        for line, cells in enumerate(grid):
            for column, cell in enumerate(cells):
                left_in, top_in = _place_in(line, column)
                box = (
                    left_in / width_in,
                    1 - (top_in + _CELL_IN) / height_in,
                    _CELL_IN / width_in,
                    _CELL_IN / height_in,
                )
                axis = figure.add_axes(box)
                axis.imshow(cell.picture.rgb_array(), interpolation="lanczos", aspect="auto")
                axis.set_axis_off()
                for text, x_in, y_in, style in _texts(line, column, cell):
                    figure.text(
                        x_in / width_in,
                        1 - y_in / height_in,
                        text,
                        ha="center",
                        va="baseline" if style != "label" else "center",
                        fontsize=_size_pt(style),
                        fontweight="bold" if style == "title" else "normal",
                        rotation=90 if style == "label" else 0,
                    )
        figure.savefig(path, dpi=300)


def _svg(grid: Sequence[Sequence[_Cell]]) -> str:
    """The grid in points of 1/72 inch."""
    width_pt, height_pt = (size_in * _POINTS for size_in in _size_in(grid))
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width_pt:.2f}pt" '
        f'height="{height_pt:.2f}pt" viewBox="0 0 {width_pt:.2f} {height_pt:.2f}" '
        f'font-family="DejaVu Sans, Helvetica, Arial, sans-serif" fill="{_INK}">',
        f'<rect width="{width_pt:.2f}" height="{height_pt:.2f}" fill="#ffffff"/>',
    ]
    for line, cells in enumerate(grid):
        for column, cell in enumerate(cells):
            left_in, top_in = _place_in(line, column)
            name = f"cell-{line}-{column}-"
            parts.append(_embedded(cell.picture.svg(), name, left_in * _POINTS, top_in * _POINTS))
            for text, x_in, y_in, style in _texts(line, column, cell):
                x_pt, y_pt = x_in * _POINTS, y_in * _POINTS
                details = ""
                if style == "title":
                    details = ' font-weight="bold"'
                elif style == "label":
                    x_pt += 2  # From the middle of the letters to their baseline.
                    details = f' transform="rotate(-90 {x_pt:.2f} {y_pt:.2f})"'
                parts.append(
                    f'<text x="{x_pt:.2f}" y="{y_pt:.2f}" text-anchor="middle" '
                    f'font-size="{_size_pt(style)}"{details}>{escape(text)}</text>'
                )
    return "\n".join([*parts, "</svg>"]) + "\n"


def _size_pt(style: str) -> int:
    return 8 if style == "title" else 6


def _texts(line: int, column: int, cell: _Cell) -> list[tuple[str, float, float, str]]:
    """(text, x, y of the baseline, style) of a cell, inches; labels are centred and upright."""
    left_in, top_in = _place_in(line, column)
    middle_in = left_in + _CELL_IN / 2
    texts = [
        (cell.captions[0], middle_in, top_in - 0.13, "caption"),
        (cell.captions[1], middle_in, top_in - 0.03, "caption"),
    ]
    if line == 0:
        texts.append((cell.title, middle_in, _TITLE_IN - 0.06, "title"))
    if column == 0:
        texts.append((cell.label, _LABEL_IN / 2, top_in + _CELL_IN / 2, "label"))
    return texts


def _place_in(line: int, column: int) -> tuple[float, float]:
    """Left and top of a picture, inches."""
    return _LABEL_IN + column * _CELL_IN, _TITLE_IN + line * _CELL_IN + (line + 1) * _CAPTION_IN


def _size_in(grid: Sequence[Sequence[_Cell]]) -> tuple[float, float]:
    return (
        _LABEL_IN + max(len(cells) for cells in grid) * _CELL_IN,
        _TITLE_IN + len(grid) * (_CELL_IN + _CAPTION_IN) + 0.02,
    )


def _embedded(svg: str, prefix: str, left_pt: float, top_pt: float) -> str:
    """A picture as a group of another one, its identifiers made unique."""
    unique = re.sub(r'\bid="', f'id="{prefix}', svg)
    unique = re.sub(r"url\(#", f"url(#{prefix}", unique)
    unique = re.sub(r'href="#', f'href="#{prefix}', unique)
    root = re.match(r'<svg [^>]*?viewBox="0 0 ([\d.]+) [\d.]+"([^>]*)>', unique)
    if root is None:
        raise ValueError("a trajectory begins with another element than expected")
    scale = _CELL_IN * _POINTS / float(root[1])
    group = f'<g transform="translate({left_pt:.2f} {top_pt:.2f}) scale({scale:.5f})"{root[2]}>'
    return group + unique[root.end() :].rstrip().removesuffix("</svg>") + "</g>"
