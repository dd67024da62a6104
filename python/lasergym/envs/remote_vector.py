"""Many environments of robot and scanner at once, stepped by native code."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from lasergym import _native
from lasergym.envs.batch_vector import BatchVectorEnv
from lasergym.envs.remote_settings import RemoteScanSettings, scan_action
from lasergym.envs.seeded_vector import autoreset_mode_of
from lasergym.envs.settings import MAX_COUNT
from lasergym.errors import OptionError, RenderModeError
from lasergym.options import integer_in

__all__ = ["RemoteScanVectorEnv"]


class RemoteScanVectorEnv(BatchVectorEnv[NDArray[np.float32], NDArray[np.int64]]):
    """Vector version of :class:`lasergym.envs.RemoteScanEnv`, equal to single ones bit for bit.

    Args:
        num_envs: Number of environments, at least 1.
        max_episode_steps: Steps after which an episode is truncated (default: never).
        autoreset_mode: What happens at the end of an episode, as for the other environments.
        episode_statistics: Whether ``infos["episode"]`` holds return, length and duration of the
            episodes that end.
        subtasks: As for the single environment, like ``area_mm2`` and ``welded``.
    """

    progress_keys = ("done", "lines", "cycle_time_s")

    def __init__(
        self,
        *,
        num_envs: int = 1,
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        episode_statistics: bool = True,
        render_mode: str | None = None,
        subtasks: int = 12,
        area_mm2: float = 75_000.0,
        welded: float = 0.2,
    ) -> None:
        """Makes the environments; see the class for the arguments."""
        super().__init__()
        if render_mode is not None:
            raise RenderModeError(
                f"render_mode is {render_mode!r}, but this vector environment has none"
            )
        self.autoreset_mode = autoreset_mode_of(autoreset_mode)
        integer_in("num_envs", num_envs, 1, MAX_COUNT)
        if max_episode_steps is not None:
            integer_in("max_episode_steps", max_episode_steps, 1, MAX_COUNT)
        self.settings = RemoteScanSettings(subtasks=subtasks, area_mm2=area_mm2, welded=welded)
        self.metadata = {"render_modes": [], "autoreset_mode": self.autoreset_mode}
        self.num_envs = num_envs
        self.render_mode = None
        self.single_observation_space = self.settings.observation_space()
        self.single_action_space = self.settings.action_space()
        self.observation_space = gym.vector.utils.batch_space(
            self.single_observation_space, num_envs
        )
        self.action_space = gym.vector.utils.batch_space(self.single_action_space, num_envs)
        self.episode_statistics = episode_statistics
        self._batch = _native.RemoteBatch(
            self.settings.as_native(), num_envs, self.autoreset_mode.value, max_episode_steps
        )
        shape = (num_envs, *self.single_observation_space.shape)
        self._observations = np.zeros(shape, np.float32)
        same_step = self.autoreset_mode == AutoresetMode.SAME_STEP
        self._final_observations = np.zeros(shape, np.float32) if same_step else None
        self._started_s = np.zeros(num_envs)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begins new episodes.

        Args:
            seed: Environment ``i`` gets ``seed + i``, or ``seed[i]`` from a sequence; without, the
                streams go on.
            options: ``{"reset_mask": mask}`` resets only where the mask is True.

        Returns:
            The observations and infos.
        """
        options = options or {}
        unknown = sorted(options.keys() - {"reset_mask"})
        if unknown:
            raise OptionError(f"unknown reset options {unknown}: there is `reset_mask`")
        mask = self._reset_mask(options.get("reset_mask"))
        native_seeds = self._native_seeds(seed, mask)
        mask_list = None if mask is None else mask.tolist()
        self._batch.reset(native_seeds, mask_list, self._observations)
        where = np.ones(self.num_envs, np.bool_) if mask is None else mask
        self._started_s[where] = time.perf_counter()
        return self._observations.copy(), self._progress_infos(where)

    def step(
        self, actions: NDArray[np.int64]
    ) -> tuple[
        NDArray[np.float32],
        NDArray[np.float64],
        NDArray[np.bool_],
        NDArray[np.bool_],
        dict[str, Any],
    ]:
        """Steps every environment.

        Args:
            actions: Integers of shape (num_envs, 2).

        Returns:
            Observations, rewards, terminations, truncations, infos.

        Raises:
            ActionError: An action is wrong; nothing has happened.
            EpisodeOverError: An episode is over and nobody resets it; nothing has happened.
        """
        array = scan_action(actions, (self.num_envs, 2))
        self._batch.step(array, self._observations, self._final_observations)
        rewards, terminated, truncated = self._batch.outcome()
        infos = self._step_infos(terminated)
        return self._observations.copy(), rewards, terminated, truncated, infos
