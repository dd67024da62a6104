"""What native vector environments share: seeds of their streams, reset masks, autoreset."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeVar

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray

from lasergym.envs.settings import native_seed
from lasergym.errors import OptionError, ShapeError

__all__ = ["SeededVectorEnv", "autoreset_mode_of"]

ObservationT = TypeVar("ObservationT")
ActionT = TypeVar("ActionT")


def autoreset_mode_of(mode: AutoresetMode | str) -> AutoresetMode:
    """The autoreset mode of its value.

    Raises:
        OptionError: There is none of that value.
    """
    try:
        return AutoresetMode(mode)
    except ValueError as error:
        names = ", ".join(f'"{one.value}"' for one in AutoresetMode)
        raise OptionError(f"autoreset_mode is {mode!r}, but must be one of {names}") from error


class SeededVectorEnv(VectorEnv[ObservationT, ActionT, NDArray[Any]]):
    """A vector environment whose streams are seeded as those of single environments."""

    def __init__(self) -> None:
        """Begins without streams; the first reset makes them."""
        super().__init__()
        self._generators: list[np.random.Generator] = []

    def _reset_mask(self, mask: Any) -> NDArray[np.bool_] | None:
        """The mask that a reset option gives, checked."""
        if mask is None:
            return None
        if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_:
            raise ShapeError("reset_mask must be a Boolean NumPy array")
        if mask.shape != (self.num_envs,):
            raise ShapeError(f"reset_mask has shape {mask.shape}, but must be ({self.num_envs},)")
        if not mask.any():
            raise ShapeError("reset_mask has no True value: nothing would be reset")
        return mask

    def _native_seeds(
        self, seed: int | Sequence[int | None] | None, mask: NDArray[np.bool_] | None
    ) -> list[int | None]:
        """The seeds of the native streams, derived as a single environment derives them."""
        if seed is None:
            seeds: Sequence[int | None] = [None] * self.num_envs
        elif isinstance(seed, (int, np.integer)):
            seeds = range(int(seed), int(seed) + self.num_envs)
            self._np_random, self._np_random_seed = gym.utils.seeding.np_random(int(seed))
        else:
            seeds = seed
        if len(seeds) != self.num_envs:
            raise ShapeError(f"{len(seeds)} seeds are given for {self.num_envs} environments")
        if not self._generators:
            self._generators = [gym.utils.seeding.np_random(one)[0] for one in seeds]
            return [native_seed(generator) for generator in self._generators]
        native: list[int | None] = [None] * self.num_envs
        for index, one in enumerate(seeds):
            if one is not None and (mask is None or mask[index]):
                self._generators[index] = gym.utils.seeding.np_random(one)[0]
                native[index] = native_seed(self._generators[index])
        return native
