"""Coarser observations, for networks that need not see every pixel."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn

from lasergym.errors import OptionError
from lasergym.targets import SIZE_PX

__all__ = ["ThinnedPixels", "thinned"]


class ThinnedPixels(VecEnvWrapper):
    """Observations of every ``every``-th row and column only.

    A pulse is 18 px wide, so with every fifth pixel little is lost, and a network needs a
    twenty-fifth of the inputs: 20 × 20 px instead of 100 × 100.
    """

    def __init__(self, venv: VecEnv, every: int = 5) -> None:
        """Wraps ``venv``, whose observations are images, channel first.

        Raises:
            OptionError: ``every`` is no divisor of the size of the images.
        """
        shape = venv.observation_space.shape
        if shape is None or len(shape) != 3:
            raise OptionError(f"observations have shape {shape}, but must be images")
        channels, height, width = shape
        if every < 1 or height % every or width % every:
            raise OptionError(f"every is {every}, but must divide {height} and {width}")
        self.every = every
        space = Box(0, 255, (channels, height // every, width // every), np.uint8)
        super().__init__(venv, space)

    def reset(self) -> NDArray[np.uint8]:
        """The first observations."""
        return thinned(self.venv.reset(), self.every)

    def step_wait(self) -> VecEnvStepReturn:
        """The next observations; terminal ones are thinned alike."""
        observations, rewards, dones, infos = self.venv.step_wait()
        for index in np.flatnonzero(dones):
            terminal = infos[index]["terminal_observation"]
            infos[index]["terminal_observation"] = thinned(terminal, self.every)
        return thinned(observations, self.every), rewards, dones, infos


def thinned(observations: Any, every: int) -> NDArray[np.uint8]:
    """Every ``every``-th row and column, from the middle of the first cell on.

    Args:
        observations: uint8 of shape (…, rows, columns).
        every: From 1, which changes nothing, to :data:`lasergym.targets.SIZE_PX`.
    """
    if not 1 <= every <= SIZE_PX:
        raise OptionError(f"every is {every}, but must be from 1 to {SIZE_PX}")
    return np.ascontiguousarray(observations[..., every // 2 :: every, every // 2 :: every])
