"""Depth maps: from files and arrays, and random ones."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lasergym import _native
from lasergym.errors import DepthMapError, OptionError
from lasergym.options import LARGEST_SEED, integer_in

__all__ = [
    "HeightScale",
    "Surface",
    "depths",
    "load_heights",
    "random_relief",
]


Surface: TypeAlias = NDArray[np.float64]

HeightScale: TypeAlias = Literal["depths", "high-stays", "high-sinks"]
"""What the values of a height map mean; see :func:`depths`."""


def load_heights(path: str | Path, *, pixel_um: float = 1.0) -> Surface:
    """Reads the heights in an NPY, ASC (DEM), PNG, TIFF or STL file; shape (rows, columns).

    Args:
        path: The file; brighter pixels of a picture are higher, of an STL the top surface counts.
        pixel_um: Side of a pixel, µm, for STL; its heights are µm above its lowest point.

    Raises:
        DepthMapError: The file is damaged or of no known kind.
    """
    path = Path(path)
    return _native.read_heights(path.name, path.read_bytes(), pixel_um)


def depths(
    heights: ArrayLike,
    *,
    depth_um: float = 1.0,
    base_um: float = 0.0,
    scale: HeightScale = "high-stays",
) -> Surface:
    """Depths of heights, µm.

    Args:
        heights: Any numbers, shape (rows, columns).
        depth_um: Difference in depth between the highest and the lowest, µm.
        base_um: Depth of the shallowest pixel, µm.
        scale: ``"high-stays"``: the highest pixel is the shallowest, as in a relief that stands up;
            ``"high-sinks"``: it is the deepest; ``"depths"``: the values are depths already, µm.

    Raises:
        DepthMapError, EmptyTargetError, OptionError: The heights or options cannot be used.
    """
    return _native.depths_of_heights(depth_array(heights), scale, depth_um, base_um)


def random_relief(seed: int = 0, *, depth_um: float = 22.5) -> Surface:
    """A smooth random target of the milling environment, depths from 0 to ``depth_um``.

    Args:
        seed: Names the relief, from 0 to 2⁶⁴ − 1. Seeds from 2 000 000 000 up are kept for
            evaluation.
        depth_um: Depth of the deepest place, µm, above 0 and at most 1e6.

    Returns:
        float64 of shape (100, 100), µm.

    Raises:
        OptionError: An argument is outside its range.
    """
    if not 0 < depth_um <= 1e6:
        raise OptionError(f"depth_um is {depth_um}, but must be above 0 and at most 1e6 µm")
    return _native.random_relief(integer_in("seed", seed, 0, LARGEST_SEED), float(depth_um))


def depth_array(values: ArrayLike) -> Surface:
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise DepthMapError(f"the depth map has values that are not numbers: {error}") from error
    if array.ndim != 2:
        raise DepthMapError(
            f"the depth map has shape {array.shape}, but must have shape (rows, columns)"
        )
    return np.ascontiguousarray(array)


def measured_depths(values: ArrayLike) -> Surface:
    """A measured surface without what noise lifts above the ground."""
    array = depth_array(values)
    if not np.isfinite(array).all():
        row, column = np.argwhere(~np.isfinite(array))[0].tolist()
        raise DepthMapError(
            f"the measured surface is {array[row, column]} at row {row}, column {column}: depths "
            "must be finite"
        )
    return np.maximum(array, 0.0)
