"""Seeds and masks of vector environments."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from lasergym.envs.settings import native_seed
from lasergym.errors import ShapeError

__all__ = ["NativeSeeds", "checked_mask"]


class NativeSeeds:
    """Derives the seeds of native streams as single environments derive them."""

    def __init__(self, num_envs: int) -> None:
        """Begins without any stream."""
        self._num_envs = num_envs
        self._generators: list[np.random.Generator] = []

    def for_reset(
        self, seed: int | Sequence[int | None] | None, mask: NDArray[np.bool_] | None
    ) -> list[int | None]:
        """The native seed of every environment; None where its stream goes on.

        Raises:
            ShapeError: There are not as many seeds as environments.
        """
        if seed is None:
            seeds: Sequence[int | None] = [None] * self._num_envs
        elif isinstance(seed, (int, np.integer)):
            seeds = range(int(seed), int(seed) + self._num_envs)
        else:
            seeds = seed
        if len(seeds) != self._num_envs:
            raise ShapeError(f"{len(seeds)} seeds are given for {self._num_envs} environments")
        if not self._generators:
            self._generators = [gym.utils.seeding.np_random(one)[0] for one in seeds]
            return [native_seed(generator) for generator in self._generators]
        native: list[int | None] = [None] * self._num_envs
        for index, one in enumerate(seeds):
            if one is not None and (mask is None or mask[index]):
                self._generators[index] = gym.utils.seeding.np_random(one)[0]
                native[index] = native_seed(self._generators[index])
        return native


def checked_mask(mask: Any, num_envs: int) -> NDArray[np.bool_] | None:
    """The mask that a reset option gives.

    Raises:
        ShapeError: It is no Boolean array of shape (num_envs,) with a True value.
    """
    if mask is None:
        return None
    if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_:
        raise ShapeError("reset_mask must be a Boolean NumPy array")
    if mask.shape != (num_envs,):
        raise ShapeError(f"reset_mask has shape {mask.shape}, but must be ({num_envs},)")
    if not mask.any():
        raise ShapeError("reset_mask has no True value: nothing would be reset")
    return mask
