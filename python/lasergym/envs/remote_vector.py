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
from lasergym.envs.remote_settings import RemoteScanSettings, scan_action
from lasergym.envs.seeded_vector import SeededVectorEnv, autoreset_mode_of
from lasergym.envs.settings import MAX_COUNT
from lasergym.errors import OptionError, RenderModeError
from lasergym.options import integer_in

__all__ = ["RemoteScanVectorEnv"]

_PROGRESS_KEYS = ("done", "lines", "cycle_time_s")


class RemoteScanVectorEnv(SeededVectorEnv[NDArray[np.float32], NDArray[np.int64]]):
    """Vector version of :class:`lasergym.envs.RemoteScanEnv`, equal to single ones bit for bit.

    Args:
        num_envs: Number of environments, at least 1.
        max_episode_steps: Steps after which an episode is truncated (default: never).
        autoreset_mode: What happens at the end of an episode, as for the other environments.
        episode_statistics: Whether ``infos["episode"]`` holds return, length and duration of the
            episodes that end.
        subtasks: As for the single environment, like ``area_mm2`` and ``welded``.
    """

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
        self._native = _native.RemoteBatch(
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
        self._native.reset(native_seeds, mask_list, self._observations)
        where = np.ones(self.num_envs, np.bool_) if mask is None else mask
        self._started_s[where] = time.perf_counter()
        return self._observations.copy(), self._infos(where)

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
        self._native.step(array, self._observations, self._final_observations)
        rewards, terminated, truncated = self._native.outcome()
        infos = self._infos(np.ones(self.num_envs, np.bool_))
        finished, success, episode_return, length = self._native.finished()
        if finished.any():
            self._add_final_infos(infos, finished, terminated, success)
            if self.episode_statistics:
                now_s = time.perf_counter()
                infos["episode"] = {
                    "r": episode_return,
                    "l": length,
                    "t": np.where(finished, now_s - self._started_s, 0.0),
                }
                infos["_episode"] = finished
                self._started_s[finished] = now_s
        return self._observations.copy(), rewards, terminated, truncated, infos

    def _infos(self, where: NDArray[np.bool_]) -> dict[str, Any]:
        """Progress of the episodes that the observations show."""
        infos: dict[str, Any] = {}
        for key, values in zip(_PROGRESS_KEYS, self._native.progress(), strict=True):
            infos[key] = np.where(where, values, 0)
            infos[f"_{key}"] = where.copy()
        return infos

    def _add_final_infos(
        self,
        infos: dict[str, Any],
        finished: NDArray[np.bool_],
        terminated: NDArray[np.bool_],
        success: NDArray[np.bool_],
    ) -> None:
        """Adds what is known of the episodes that have just ended."""
        final = infos
        if self._final_observations is not None:
            final = {}
            for key, values in zip(_PROGRESS_KEYS, self._native.final_progress(), strict=True):
                final[key] = values
                final[f"_{key}"] = finished.copy()
            observations = np.zeros_like(self._final_observations)
            observations[finished] = self._final_observations[finished]
            infos["final_obs"] = observations
            infos["_final_obs"] = finished.copy()
            infos["final_info"] = final
            infos["_final_info"] = finished.copy()
        if terminated.any():
            final["is_success"] = success & terminated
            final["_is_success"] = terminated.copy()
