"""Targets: what a workpiece is to look like.

A target is a Boolean array of shape (100, 100), rows from top to bottom, columns from left to
right; a pixel is 1 µm and True where it is to be machined.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from lasergym import _native
from lasergym.errors import OptionError, TargetShapeError
from lasergym.options import LARGEST_SEED, integer_in

__all__ = [
    "SIZE_PX",
    "Fit",
    "Ink",
    "Target",
    "TargetLike",
    "as_target",
    "load",
    "random_shape",
    "random_shape_areas",
    "save",
    "star",
]

SIZE_PX = 100
"""Width and height of the workpiece, px; 1 px is 1 µm."""

Target: TypeAlias = NDArray[np.bool_]
"""A Boolean array of shape (100, 100)."""

TargetLike: TypeAlias = "NDArray[Any] | str | os.PathLike[str]"
"""A target, an array of zeros and ones, or the name of a drawing."""


Ink: TypeAlias = Literal["auto", "luminance", "alpha"]
"""What of a drawing counts as ink."""

Fit: TypeAlias = Literal["scale", "exact"]
"""Where a drawing lies on the workpiece."""


def star(angle_deg: float = 0.0) -> Target:
    """The five-pointed star of Xie et al. (2022), sections 3.1 and 3.2.

    Args:
        angle_deg: Turn about the centre of the workpiece, clockwise, degrees. At 0 a tip points up.

    Returns:
        Boolean array of shape (100, 100) with 4842 px at 0°. What leaves the workpiece is lost.
    """
    if not np.isfinite(angle_deg):
        raise OptionError(f"angle_deg is {angle_deg}, but must be finite")
    return _native.star(float(angle_deg))


def random_shape(seed: int = 0) -> Target:
    """A random smooth shape of Xie et al. (2022), section 3.3.

    Seven random pixel centres joined by Bézier segments, redrawn while the area is under 3000 px.

    Args:
        seed: Names the shape, from 0 to 2⁶⁴ − 1. Seeds from 2 000 000 000 up are kept for
            evaluation: nothing that ships with lasergym was trained or tuned on them.

    Returns:
        Boolean array of shape (100, 100).
    """
    return _native.random_shape(integer_in("seed", seed, 0, LARGEST_SEED))


def random_shape_areas(first_seed: int, count: int) -> NDArray[np.int64]:
    """Areas of random shapes, without the shapes themselves.

    Args:
        first_seed: The first seed, as for :func:`random_shape`.
        count: How many consecutive seeds, from 0 to 10 million.

    Returns:
        Areas, px, shape (count,).
    """
    integer_in("count", count, 0, 10_000_000)
    integer_in("first_seed", first_seed, 0, LARGEST_SEED - count)
    return _native.random_shape_areas(first_seed, count)


def load(
    path: str | os.PathLike[str],
    *,
    margin_px: float = 5.0,
    threshold: float = 0.5,
    ink: Ink = "auto",
    invert: bool = False,
    fit: Fit = "scale",
) -> Target:
    """Reads a drawing as a target.

    Args:
        path: A PNG, JPEG, SVG or DXF file; the content decides which.
        margin_px: Free border of the workpiece on each side, px, from 0 to 45.
        threshold: A pixel is target when its mean amount of ink is at least this, in (0, 1].
        ink: What counts as ink: ``"luminance"`` dark, ``"alpha"`` opaque, ``"auto"`` dark, or, in a
            picture with transparency, whatever is painted and not white.
        invert: Whether what is not ink becomes the target.
        fit: ``"scale"`` scales the ink, with its aspect kept, to the workpiece less the margin and
            centres it; ``"exact"`` takes one pixel or unit of the drawing as one pixel of the
            workpiece.

    Returns:
        Boolean array of shape (100, 100).

    Raises:
        DrawingError: The file cannot be read; a named child says why.
        EmptyTargetError: Nothing of the drawing is ink.
        FullTargetError: All of the workpiece is ink.
    """
    return _native.load_drawing(Path(path), margin_px, threshold, ink, invert, fit)


def save(target: TargetLike, path: str | os.PathLike[str]) -> None:
    """Writes a target as a PNG file of 100 × 100 px, black where it is to be machined.

    ``load(path, fit="exact")`` reads it back bit for bit.
    """
    Path(path).write_bytes(_native.target_png(as_target(target)))


def as_target(target: TargetLike) -> Target:
    """Checks that ``target`` is a target, or reads it from a drawing.

    Args:
        target: A Boolean array of shape (100, 100), an array of zeros and ones of that shape, or
            the name of a PNG, JPEG, SVG or DXF file.

    Returns:
        Boolean array of shape (100, 100).

    Raises:
        TargetShapeError: The array has another shape or other values.
        DrawingError: The drawing cannot be read.
    """
    if isinstance(target, (str, os.PathLike)):
        return load(Path(target))
    array = np.asarray(target)
    if array.shape != (SIZE_PX, SIZE_PX):
        raise TargetShapeError(
            f"the target has shape {array.shape}, but must have shape ({SIZE_PX}, {SIZE_PX})"
        )
    if array.dtype != np.bool_:
        if array.dtype.kind not in "uif" or not np.isin(array, (0, 1)).all():
            raise TargetShapeError(
                f"the target has dtype {array.dtype} and values other than 0 and 1: "
                "pass a Boolean array, for instance target > 127"
            )
        array = array.astype(np.bool_)
    return np.ascontiguousarray(array)
