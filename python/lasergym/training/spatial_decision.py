"""What a spatial decision is: the figures that policy, teacher and runner share; needs no torch."""

from __future__ import annotations

__all__ = [
    "CORRECTION_REACH_PX",
    "CORRECTION_WIDTH",
    "LAYER_SCALES_PX",
    "POLISH_PX",
    "RING_WEIGHT",
    "VIEW_CHANNELS",
    "VIEW_SIZE",
]

CORRECTION_REACH_PX = 8
"""How far corrections reach from the place of best ring score along x and along y, px."""

CORRECTION_WIDTH = 2 * CORRECTION_REACH_PX + 1
"""Rows and columns of the corrections."""

RING_WEIGHT = 0.35
"""Default weight of the ring in the score gain − weight × ring that is corrected."""

POLISH_PX = 0.5
"""Default range of the polish below the pixel along x and along y, px."""

VIEW_SIZE = 28
"""Width and height of a channel; every channel holds every other row and column of 56 px."""

VIEW_CHANNELS = 18
"""Four for each layer, and two constant ones."""

LAYER_SCALES_PX = (1.0, 1.0, 128.0, 128.0)
"""What the layers of a view are divided by: remaining target, forbidden ground, gain, ring."""
