"""How promising every pixel centre is for the next pulse, from observations."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from lasergym.targets import SIZE_PX

__all__ = ["LARGEST_RADIUS_PX", "RING_WIDTH_PX", "RingScores", "disc_sums", "ring_scores"]

RING_WIDTH_PX = 3.0
"""Width of the ring about a pulse in which remaining target counts against it, px."""

LARGEST_RADIUS_PX = 50.0
"""Pulses and rings reach no further, px."""


@dataclass(frozen=True, eq=False)
class RingScores:
    """What observations say about every place; the same numbers as those of the planners.

    Attributes:
        layers: Remaining target (0 or 1), forbidden ground (0 or 1), gain of a pulse (hits −
            misses, px) and remaining target in its ring (px) at every pixel centre; int16 of shape
            (batch, 4, 100, 100).
        scores_px: Gain − ring weight × ring, px; float32 of shape (batch, 100, 100).
        candidates: Row and column of the best place; int64 of shape (batch, 2).
        pulses_left: Pulses that are left, float32 of shape (batch,).
    """

    layers: Tensor
    scores_px: Tensor
    candidates: Tensor
    pulses_left: Tensor

    @property
    def gains_px(self) -> Tensor:
        """Gain of a pulse at every pixel centre, int16 of shape (batch, 100, 100)."""
        return self.layers[:, 2]

    @property
    def worth(self) -> Tensor:
        """1 where target remains, −1 where ground is forbidden; int16, (batch, 100, 100)."""
        return self.layers[:, 0] - self.layers[:, 1]


def ring_scores(
    observations: Tensor, *, pulse_radius_px: float, ring_weight: float, max_pulses: int
) -> RingScores:
    """The ring scores of observations.

    The best place is the pixel of largest score among those that gain anything, the first of
    several in the order of rows; where none gains, the one of largest gain.

    Args:
        observations: ``"layers"`` as the environments give them, 0 to 255 of any dtype; shape
            (batch, 3, 100, 100).
        pulse_radius_px: Radius of a pulse, px.
        ring_weight: Weight of the ring; with 0 rings are left out and 0 everywhere.
        max_pulses: Pulses of a whole episode. Up to 255 the pulses left are exact.
    """
    remaining, forbidden = (observations[:, :2] > 0).to(torch.int16).unbind(1)
    gains = disc_sums(remaining - forbidden, pulse_radius_px)
    rings = torch.zeros_like(gains)
    if ring_weight > 0:
        outer_px = min(pulse_radius_px + RING_WIDTH_PX, LARGEST_RADIUS_PX)
        rings = disc_sums(remaining, outer_px) - disc_sums(remaining, pulse_radius_px)
    promises = gains.float() - ring_weight * rings.float()
    promises = promises.masked_fill(gains <= 0, -torch.inf).flatten(1)
    # argmax gives the first of several.
    best = torch.where(
        promises.amax(1) > -torch.inf, promises.argmax(1), gains.flatten(1).argmax(1)
    )
    levels = observations[:, 2, 0, 0].double()
    return RingScores(
        torch.stack([remaining, forbidden, gains, rings], 1),
        (gains.double() - ring_weight * rings.double()).float(),
        torch.stack([best // SIZE_PX, best % SIZE_PX], 1),
        torch.round(levels * max_pulses / 255.0).float(),
    )


def disc_sums(values: Tensor, radius_px: float) -> Tensor:
    """Sums of the values whose pixel centres lie within a radius of each pixel centre.

    A convolution with the disc, as differences of running sums along the rows: many times faster,
    and exact.

    Args:
        values: Whole numbers in [−1, 1], int16 of shape (batch, height, width) up to 100 px; 0 is
            beyond.
        radius_px: Radius of the disc, px, up to 50.
    """
    height, width = values.shape[-2:]
    half_widths = _half_widths(radius_px)
    reach = len(half_widths) - 1
    padded = functional.pad(values, (reach + 1, reach, reach, reach))
    running = padded.cumsum(2, dtype=torch.int16)
    sums = torch.zeros_like(values)
    for half_width in sorted(set(half_widths)):
        right = reach + half_width + 1
        left = reach - half_width
        slabs = running[..., right : right + width] - running[..., left : left + width]
        for row in range(-reach, reach + 1):
            if half_widths[abs(row)] == half_width:
                sums += slabs[:, reach + row : reach + row + height]
    return sums


def _half_widths(radius_px: float) -> list[int]:
    """Columns that a disc at a pixel centre covers on either side of it, by rows from it."""
    reach = range(int(radius_px) + 1)
    squared = radius_px * radius_px
    return [max(x for x in reach if x * x + y * y <= squared) for y in reach]
