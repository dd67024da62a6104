"""A density of actions over the pixels of the workpiece."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.distributions import Distribution
from torch import Tensor, nn

from lasergym.targets import SIZE_PX

__all__ = ["CellDistribution", "InverseTemperature"]

_LOG_CELL_AREA = 2.0 * math.log(2.0 / SIZE_PX)
"""A pixel is 0.02 × 0.02 in units of actions."""


class InverseTemperature(nn.Module):
    """Turns values into logits by a positive factor that is learnt."""

    def __init__(self, initial_per_px: float) -> None:
        """Makes the factor, 1/px, which is above 0."""
        super().__init__()
        self.log_per_px = nn.Parameter(torch.tensor(math.log(initial_per_px)))

    def forward(self, values_px: Tensor) -> Tensor:
        """Logits of values."""
        return values_px * self.log_per_px.exp()


class CellDistribution(Distribution):
    """Every pixel has a probability; within a pixel all actions are equally probable.

    A proper density on [-1, 1]²: nothing is clipped. An action on a border belongs to the pixel
    that begins there, 1 to the last.
    """

    def __init__(self) -> None:
        """Makes a distribution without parameters."""
        super().__init__()  # type: ignore[no-untyped-call]
        self._log_probabilities = torch.empty(0, SIZE_PX * SIZE_PX)
        self._best_actions: Callable[[], Tensor] | None = None

    def proba_distribution_net(self, initial_per_px: float = 0.5) -> InverseTemperature:
        """What turns values of pixels into parameters."""
        return InverseTemperature(initial_per_px)

    def proba_distribution(
        self, logits: Tensor, best_actions: Callable[[], Tensor] | None = None
    ) -> CellDistribution:
        """Sets the parameters.

        Args:
            logits: Of the pixels, shape (batch, 100, 100), rows from top to bottom.
            best_actions: Gives what :meth:`mode` gives; by default the centres of the most probable
                pixels.

        Returns:
            Itself.
        """
        self._log_probabilities = logits.flatten(1).log_softmax(1)
        self._best_actions = best_actions
        return self

    @property
    def probabilities(self) -> Tensor:
        """Probabilities of the pixels, shape (batch, 100, 100)."""
        return self._log_probabilities.exp().view(-1, SIZE_PX, SIZE_PX)

    def log_prob(self, actions: Tensor) -> Tensor:
        """Logarithm of the density at actions, shape (batch,).

        Args:
            actions: Shape (batch, 2); a distribution of one state takes any number.
        """
        positions_px = (SIZE_PX / 2) * (1.0 + actions.double())
        columns, rows = positions_px.floor().long().clamp(0, SIZE_PX - 1).unbind(-1)
        cells = (rows * SIZE_PX + columns)[:, None]
        logs = self._log_probabilities.expand(len(cells), -1)
        return logs.gather(1, cells)[:, 0] - _LOG_CELL_AREA

    def entropy(self) -> Tensor:
        """Differential entropy, exact; shape (batch,)."""
        logs = self._log_probabilities
        return _LOG_CELL_AREA - (logs.exp() * logs).sum(1)

    def sample(self) -> Tensor:
        """Random actions, shape (batch, 2)."""
        bounds = self._log_probabilities.detach().double().exp().cumsum(1)
        heights = torch.rand_like(bounds[:, :1]) * bounds[:, -1:]
        drawn = torch.searchsorted(bounds, heights, right=True).clamp(max=SIZE_PX * SIZE_PX - 1)
        cells = torch.cat([drawn % SIZE_PX, drawn // SIZE_PX], 1)
        within = torch.rand(cells.shape, dtype=torch.float64, device=cells.device)
        actions = ((cells + within) / (SIZE_PX / 2) - 1.0).float()
        # Rounding must not carry an action over the border of its pixel.
        first, last = (torch.as_tensor(bound, device=cells.device) for bound in _BOUNDS)
        return actions.clamp(first[cells], last[cells])

    def mode(self) -> Tensor:
        """The best actions, shape (batch, 2)."""
        if self._best_actions is not None:
            return self._best_actions()
        cells = self._log_probabilities.argmax(1)
        centers = torch.stack([cells % SIZE_PX, cells // SIZE_PX], 1).double() + 0.5
        return (centers / (SIZE_PX / 2) - 1.0).float()

    def actions_from_params(self, logits: Tensor, deterministic: bool = False) -> Tensor:
        """Actions of a distribution with these logits."""
        return self.proba_distribution(logits).get_actions(deterministic)

    def log_prob_from_params(self, logits: Tensor) -> tuple[Tensor, Tensor]:
        """Random actions of a distribution with these logits, and their log density."""
        actions = self.actions_from_params(logits)
        return actions, self.log_prob(actions)


def _bounds() -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """A first and a last float32 of each column of pixels."""
    edges = np.arange(SIZE_PX + 1) / (SIZE_PX / 2) - 1.0
    step = 2.0**-24  # At least half the distance of neighbours in float32.

    def moved(edge: float, column: int, direction: float) -> np.float32:
        action = np.float32(edge)
        while np.floor((SIZE_PX / 2) * (1.0 + float(action))) != column:
            edge += direction * step
            action = np.float32(edge)
        return action

    first = [moved(edge, column, 1.0) for column, edge in enumerate(edges[:-1].tolist())]
    last = [moved(edge, column, -1.0) for column, edge in enumerate(edges[1:].tolist())]
    return np.array(first, np.float32), np.array(last, np.float32)


_BOUNDS: Any = _bounds()
