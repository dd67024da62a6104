"""What native vector environments of all processes have in common."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from lasergym.envs.batch_vector import BatchVectorEnv
from lasergym.envs.seeded_vector import autoreset_mode_of
from lasergym.envs.settings import MAX_COUNT, action_array, batched_box
from lasergym.errors import OptionError, RenderModeError, ShapeError
from lasergym.options import integer_in

if TYPE_CHECKING:
    from lasergym.envs.settings import ActionSpace, ImageSpace

__all__ = ["NativeVectorEnv"]


class _Settings(Protocol):
    """What the settings of a process know of its spaces."""

    def observation_space(self) -> ImageSpace:
        """The space of one observation."""

    def action_space(self) -> ActionSpace:
        """The space of one action."""


class NativeVectorEnv(BatchVectorEnv[NDArray[np.uint8], NDArray[np.float32]]):
    """Environments of one process, stepped by native code; the base of the vector environments."""

    settings: Any

    def _make(
        self,
        native: Callable[[int, str, int | None, int], Any],
        *,
        num_envs: int,
        max_episode_steps: int | None,
        autoreset_mode: AutoresetMode | str,
        threads: int,
        copy: bool,
        episode_statistics: bool,
        render_mode: str | None,
    ) -> None:
        """Checks the arguments that all vector environments share and makes the batch.

        ``self.settings`` must be set; ``native`` makes the batch of (number, autoreset mode, step
        limit, threads). See :class:`lasergym.envs.AblationVectorEnv` for the others.
        """
        if render_mode not in (None, "rgb_array"):
            raise RenderModeError(
                f'render_mode is {render_mode!r}, but vector environments have "rgb_array" only'
            )
        self.autoreset_mode = autoreset_mode_of(autoreset_mode)
        integer_in("num_envs", num_envs, 1, MAX_COUNT)
        integer_in("threads", threads, 1, 1024)
        if max_episode_steps is not None:
            integer_in("max_episode_steps", max_episode_steps, 1, MAX_COUNT)
        self.metadata = {
            "render_modes": ["rgb_array"],
            "render_fps": 10,
            "autoreset_mode": self.autoreset_mode,
        }
        self.num_envs = num_envs
        self.render_mode = render_mode
        settings: _Settings = self.settings
        self.single_observation_space = settings.observation_space()
        action_space = settings.action_space()
        self.single_action_space = action_space
        self.action_space = batched_box(action_space, num_envs)
        self.max_episode_steps = max_episode_steps
        self.copy = copy
        self.episode_statistics = episode_statistics
        self._batch = native(num_envs, self.autoreset_mode.value, max_episode_steps, threads)
        self._action_shape = (num_envs, *action_space.shape)
        shape = (num_envs, *self.single_observation_space.shape)
        self._observations = np.zeros(shape, np.uint8)
        same_step = self.autoreset_mode == AutoresetMode.SAME_STEP
        self._final_observations = np.zeros(shape, np.uint8) if same_step else None
        self._generators = []
        self._started_s = np.zeros(num_envs)

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """A picture of every environment.

        Returns:
            With ``render_mode="rgb_array"`` one array (uint8 of shape (400, 400, 3)) per
            environment.
        """
        if self.render_mode is None:
            gym.logger.warn(
                "render() needs a render mode: gym.make_vec(..., render_mode='rgb_array')"
            )
            return None
        pictures = (self.render_one(index) for index in range(self.num_envs))
        return tuple(picture for picture in pictures if picture is not None)

    def render_one(self, index: int) -> NDArray[np.uint8] | None:
        """A picture of one environment, see :meth:`render`."""
        raise NotImplementedError

    def _as_target(self, target: Any) -> Any:
        """A target as the native batch takes it."""
        raise NotImplementedError

    def _after_reset(self, where: NDArray[np.bool_]) -> None:
        """Called when episodes have been begun by :meth:`reset`."""

    def _after_step(self) -> None:
        """Called when all environments have been stepped."""

    @cached_property
    def observation_space(self) -> ImageSpace:  # type: ignore[override]  # made lazily
        """The space of batched observations, made when first asked for."""
        return batched_box(self.settings.observation_space(), self.num_envs)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[NDArray[np.uint8], dict[str, Any]]:
        """Begins new episodes.

        Args:
            seed: Environment ``i`` gets ``seed + i``, or ``seed[i]`` from a sequence; without, the
                streams go on. Each equals ``reset(seed=…)`` of a single environment.
            options: ``{"reset_mask": mask}`` (Boolean array of shape (num_envs,)) resets only where
                the mask is True. ``{"target": target}`` machines that target in these episodes; a
                list of targets (or None) names one for each environment.

        Returns:
            The observations and infos.
        """
        options = options or {}
        unknown = sorted(options.keys() - {"reset_mask", "target"})
        if unknown:
            raise OptionError(
                f"unknown reset options {unknown}: there are `reset_mask` and `target`"
            )
        mask = self._reset_mask(options.get("reset_mask"))
        targets = self._targets(options.get("target"))
        native_seeds = self._native_seeds(seed, mask)
        mask_list = None if mask is None else mask.tolist()
        self._batch.reset(native_seeds, mask_list, self._observations)
        resets = np.ones(self.num_envs, np.bool_) if mask is None else mask
        for index in np.flatnonzero(resets).tolist():
            target = targets[index]
            if target is not None:
                self._batch.reset_to(index, target, self._observations)
        self._started_s[resets] = time.perf_counter()
        self._after_reset(resets)
        return self._returned_observations(), self._progress_infos(resets)

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[
        NDArray[np.uint8], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]
    ]:
        """Does one step in every environment.

        Args:
            actions: float32 of shape (num_envs, length of one action).

        Returns:
            Observations, rewards, terminations, truncations, infos.

        Raises:
            ActionError: Wrong shape or dtype, or a component that is not finite; nothing has
                happened.
            EpisodeOverError: An episode is over and nobody resets it; nothing has happened.
        """
        array = action_array(actions, self._action_shape)
        self._batch.step(array, self._observations, self._final_observations)
        self._after_step()
        terminated, truncated = self._batch.terminated(), self._batch.truncated()
        infos = self._step_infos(terminated)
        return (
            self._returned_observations(),
            self._batch.rewards(),
            terminated,
            truncated,
            infos,
        )

    def _targets(self, target: Any) -> list[Any]:
        """The targets that a reset option names, one for each environment."""
        if target is None:
            return [None] * self.num_envs
        if not isinstance(target, (list, tuple)):
            return [self._as_target(target)] * self.num_envs
        if len(target) != self.num_envs:
            raise ShapeError(f"{len(target)} targets are given for {self.num_envs} environments")
        return [None if one is None else self._as_target(one) for one in target]

    def _returned_observations(self) -> NDArray[np.uint8]:
        return self._observations.copy() if self.copy else self._observations
