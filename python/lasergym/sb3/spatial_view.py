"""What the network of a spatial policy sees: the surroundings of the best place by ring score."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from lasergym.sb3.spatial_scores import RingScores
from lasergym.training.spatial_decision import LAYER_SCALES_PX, VIEW_CHANNELS, VIEW_SIZE

__all__ = ["VIEW_CHANNELS", "VIEW_SIZE", "views"]

_WIDTH_PX = 2 * VIEW_SIZE
_PULSE_SCALE = 45.0
_AREA_PER_PULSE_PX = 250.0


def views(scores: RingScores) -> Tensor:
    """What the network sees, float32 of shape (batch, 18, 28, 28).

    The candidate lies in row and column 28 of a square of 56 px, counted from 0. Each of the layers
    remaining target, forbidden ground, gain ÷ 128 px and ring ÷ 128 px fills four channels, as
    ``torch.nn.PixelUnshuffle`` orders them; what lies beside the workpiece is 0. The last two are
    constant: pulses left ÷ 45, and remaining target ÷ (250 px × pulses left).
    """
    half = _WIDTH_PX // 2
    padded = functional.pad(scores.layers, (half, half, half, half))
    squares = padded.unfold(2, _WIDTH_PX, 1).unfold(3, _WIDTH_PX, 1)
    rows, columns = scores.candidates.unbind(1)
    each = torch.arange(len(rows), device=rows.device)
    scales = torch.tensor(LAYER_SCALES_PX, device=rows.device)[:, None, None]
    seen = functional.pixel_unshuffle(squares[each, :, rows, columns] / scales, 2)
    pulses_left = scores.pulses_left.clamp(min=1.0)
    areas_px = scores.layers[:, 0].sum((1, 2)).float()
    constants = torch.stack(
        [pulses_left / _PULSE_SCALE, areas_px / (_AREA_PER_PULSE_PX * pulses_left)], 1
    )
    planes = constants[:, :, None, None].expand(-1, -1, VIEW_SIZE, VIEW_SIZE)
    return torch.cat([seen, planes], 1)
