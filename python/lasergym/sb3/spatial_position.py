"""From corrections of the ring score to actions."""

from __future__ import annotations

import torch
from torch import Tensor

from lasergym.sb3.spatial_network import CORRECTION_REACH_PX
from lasergym.sb3.spatial_scores import LARGEST_RADIUS_PX, RING_WIDTH_PX, RingScores
from lasergym.targets import SIZE_PX

__all__ = ["best_actions", "best_pixels", "corrected_scores"]

_STEPS_PER_PX = 8
_WIDTH = 2 * CORRECTION_REACH_PX + 1


def corrected_scores(scores: RingScores, corrections: Tensor) -> Tensor:
    """Ring scores, with corrections within their reach; px, shape (batch, 100, 100).

    Args:
        scores: The ring scores.
        corrections: About their candidates, px, shape (batch, 17, 17).
    """
    reach = CORRECTION_REACH_PX
    size = SIZE_PX + 2 * reach
    rows, columns = _window(scores.candidates)
    places = (rows[:, :, None] + reach) * size + columns[:, None, :] + reach
    spread = corrections.new_zeros(len(corrections), size * size)
    spread = spread.scatter(1, places.flatten(1), corrections.flatten(1)).view(-1, size, size)
    return scores.scores_px + spread[:, reach:-reach, reach:-reach]


def best_pixels(scores: RingScores, corrections: Tensor) -> Tensor:
    """The pixel of largest score + correction within reach, the first of several.

    Only the candidate and pixels that gain anything count.

    Returns:
        Rows and columns, int64 of shape (batch, 2).
    """
    rows, columns = _window(scores.candidates)
    within = _on_workpiece(rows)[:, :, None] & _on_workpiece(columns)[:, None, :]
    inside = SIZE_PX - 1
    rows_inside, columns_inside = rows.clamp(0, inside), columns.clamp(0, inside)
    within &= _taken(scores.gains_px, rows_inside, columns_inside) > 0
    within[:, CORRECTION_REACH_PX, CORRECTION_REACH_PX] = True
    values = _taken(scores.scores_px, rows_inside, columns_inside) + corrections
    best = values.masked_fill(~within, -torch.inf).flatten(1).argmax(1, keepdim=True)
    return torch.cat([rows.gather(1, best // _WIDTH), columns.gather(1, best % _WIDTH)], 1)


@torch.no_grad()
def best_actions(
    scores: RingScores,
    corrections: Tensor,
    *,
    pulse_radius_px: float,
    ring_weight: float,
    polish_px: float,
) -> Tensor:
    """The best actions: the best pixel, polished.

    Within ``polish_px`` of its centre, in steps of 1/8 px, the place of largest ring score +
    correction is taken among those that gain anything, of several the nearest. Scores are those of
    the position that the action, which is float32, stands for. Between pixels corrections are
    bilinear, beyond the last ones constant.

    Args:
        scores: The ring scores.
        corrections: About their candidates, px, shape (batch, 17, 17).
        pulse_radius_px: Radius of a pulse, px.
        ring_weight: Weight of the ring in the scores.
        polish_px: Range of the polish along x and y, px; 0 keeps the centre.

    Returns:
        Actions in [-1, 1], float32 of shape (batch, 2).
    """
    pixels = best_pixels(scores, corrections)
    reach = int(polish_px * _STEPS_PER_PX)
    steps = torch.arange(-reach, reach + 1, device=pixels.device)
    offsets = steps.double() / _STEPS_PER_PX
    wanted = pixels[:, :, None].double() + 0.5 + offsets  # (batch, row or column, step)
    actions = (wanted / (SIZE_PX / 2) - 1.0).float()
    positions = (SIZE_PX / 2) * (1.0 + actions.double())
    reach_px = pulse_radius_px + RING_WIDTH_PX + polish_px

    def machined(worth: Tensor, radius_px: float) -> Tensor:
        return _disc_sums(worth, pixels, positions, radius_px, reach_px)

    values = gains = machined(scores.worth, pulse_radius_px)
    if ring_weight > 0:
        remaining = scores.layers[:, 0]
        outer_px = min(pulse_radius_px + RING_WIDTH_PX, LARGEST_RADIUS_PX)
        rings = machined(remaining, outer_px) - machined(remaining, pulse_radius_px)
        values = (gains.double() - ring_weight * rings.double()).float()
    values = values.masked_fill(gains <= 0, -torch.inf)
    from_candidates = positions - (scores.candidates[:, :, None].double() + 0.5)
    values = values + _between(corrections, from_candidates)
    valid = ((wanted >= 0.0) & (wanted <= SIZE_PX)).unbind(1)
    values = values.masked_fill(~(valid[0][:, :, None] & valid[1][:, None, :]), -torch.inf)
    values = values.flatten(1)
    # Of the largest the nearest, of these the first.
    distances = (steps[:, None] ** 2 + steps**2).flatten().expand_as(values)
    largest = values == values.amax(1, keepdim=True)
    best = distances.where(largest, distances.max() + 1).argmin(1, keepdim=True)
    along_y, along_x = actions.unbind(1)
    chosen_x = along_x.gather(1, best % len(steps))
    chosen_y = along_y.gather(1, best // len(steps))
    return torch.cat([chosen_x, chosen_y], 1)


def _disc_sums(
    worth: Tensor, pixels: Tensor, positions: Tensor, radius_px: float, reach_px: float
) -> Tensor:
    """What discs cover at every combination of positions along y and x, px.

    Args:
        worth: What each pixel counts, shape (batch, 100, 100).
        pixels: Rows and columns that the positions are near to, (batch, 2).
        positions: Along y and along x, px, (batch, 2, steps).
        radius_px: Radius of the discs, px.
        reach_px: No disc reaches further from its pixel, px.

    Returns:
        float32 of shape (batch, steps along y, steps along x).
    """
    reach = int(reach_px) + 1
    near = pixels[:, :, None] + torch.arange(-reach, reach + 1, device=pixels.device)
    on_workpiece = _on_workpiece(near)
    rows, columns = near.clamp(0, SIZE_PX - 1).unbind(1)
    worth = _taken(worth, rows, columns)
    worth = worth * on_workpiece[:, 0, :, None] * on_workpiece[:, 1, None, :]
    squares = (near[:, :, None, :].double() + 0.5 - positions[:, :, :, None]).square()
    along_y, along_x = squares.unbind(1)  # Each (batch, step, row or column).
    discs = along_x[:, None, :, None, :] + along_y[:, :, None, :, None] <= radius_px**2
    covered = discs.flatten(3).flatten(1, 2).float()
    steps = positions.shape[2]
    sums: Tensor = covered @ worth.float().flatten(1)[:, :, None]
    return sums.reshape(-1, steps, steps)


def _between(corrections: Tensor, places: Tensor) -> Tensor:
    """Corrections between pixels.

    Args:
        corrections: px, shape (batch, 17, 17).
        places: Rows and columns from the candidate, px, float64 of shape (batch, 2, steps).

    Returns:
        float32 of shape (batch, steps of rows, steps of columns).
    """
    places = (places + CORRECTION_REACH_PX).clamp(0, _WIDTH - 1)
    wholes = places.long().clamp(max=_WIDTH - 2)
    rows, columns = wholes.unbind(1)
    down, right = (places - wholes).float().unbind(1)
    down, right = down[:, :, None], right[:, None, :]

    def along(rows: Tensor) -> Tensor:
        first, second = (_taken(corrections, rows, columns + one) for one in (0, 1))
        return (1.0 - right) * first + right * second

    return (1.0 - down) * along(rows) + down * along(rows + 1)


def _window(candidates: Tensor) -> tuple[Tensor, Tensor]:
    """Rows and columns that corrections are for, shapes (batch, 17), some beside the workpiece."""
    reach = CORRECTION_REACH_PX
    around = candidates[:, :, None] + torch.arange(-reach, reach + 1, device=candidates.device)
    rows, columns = around.unbind(1)
    return rows, columns


def _taken(values: Tensor, rows: Tensor, columns: Tensor) -> Tensor:
    """Values at every combination of rows and columns, (batch, len(rows), len(columns))."""
    each = torch.arange(len(values), device=values.device)[:, None, None]
    return values[each, rows[:, :, None], columns[:, None, :]]


def _on_workpiece(indices: Tensor) -> Tensor:
    return (indices >= 0) & (indices < SIZE_PX)
