"""Many pulse-ablation environments at once, stepped by native code."""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray

from lasergym import _native
from lasergym.envs.seeding import NativeSeeds, checked_mask
from lasergym.envs.settings import (
    MAX_COUNT,
    ObservationMode,
    Settings,
    Task,
    action_array,
    batched_box,
)
from lasergym.errors import OptionError, RenderModeError, ShapeError
from lasergym.options import integer_in
from lasergym.render import Trajectory
from lasergym.targets import Target, TargetLike, as_target

if TYPE_CHECKING:
    from lasergym.envs.settings import ImageSpace

__all__ = [
    "AblationVectorEnv",
    "PatternVectorEnv",
    "RandomShapeVectorEnv",
    "RotatedStarVectorEnv",
    "StarVectorEnv",
]


class AblationVectorEnv(VectorEnv[NDArray[np.uint8], NDArray[np.float32], NDArray[Any]]):
    """Many pulse-ablation environments of one task, equal to single ones bit for bit.

    ``gym.make_vec("lasergym/Star-v0", num_envs=1024)`` makes it. The arguments of the single
    environments apply to all; besides them:

    Args:
        num_envs: Number of environments, at least 1.
        max_episode_steps: Steps after which an episode is truncated (default: never).
        autoreset_mode: What happens at the end of an episode (``gymnasium.vector.AutoresetMode`` or
            its value). ``NEXT_STEP`` (default) resets in the step after the last, ``SAME_STEP`` in
            the last step itself, with ``infos["final_obs"]`` and ``infos["final_info"]``,
            ``DISABLED`` leaves it to ``reset(options={"reset_mask": mask})``.
        threads: Worker threads, at least 1. The results do not depend on their number.
        copy: Whether ``reset`` and ``step`` return copies of the observations (default), as
            ``SyncVectorEnv`` does. Without, they return the buffer that the next step writes to, in
            which only the pixels that changed are written: much faster, but keep no reference to
            it.
        episode_statistics: Whether ``infos["episode"]`` holds return ``r``, length ``l`` and
            duration ``t`` of the episodes that end. Switch it off to use
            ``RecordEpisodeStatistics`` instead.

    ``infos`` holds arrays of shape (num_envs,) with a mask ``_key`` beside each ``key``, as in
    ``SyncVectorEnv``. ``final_obs`` is one dense array of shape (num_envs, channels, 100, 100);
    where ``_final_obs`` is False it is zero.
    """

    task: ClassVar[Task]

    def __init__(
        self,
        *,
        num_envs: int = 1,
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int = 1,
        copy: bool = True,
        episode_statistics: bool = True,
        render_mode: str | None = None,
        target: TargetLike | None = None,
        observation: ObservationMode = "remaining",
        pulse_radius_px: float = 9.0,
        max_pulses: int = 45,
        completion: float = 0.99,
        pointing_error_px: float = 0.0,
        radius_error: float = 0.0,
        stop_on_miss: bool = False,
    ) -> None:
        """Makes the environments; see the class for the arguments."""
        super().__init__()
        if render_mode not in (None, "rgb_array"):
            raise RenderModeError(
                f'render_mode is {render_mode!r}, but vector environments have "rgb_array" only'
            )
        try:
            self.autoreset_mode = AutoresetMode(autoreset_mode)
        except ValueError as error:
            names = ", ".join(f'"{mode.value}"' for mode in AutoresetMode)
            raise OptionError(
                f"autoreset_mode is {autoreset_mode!r}, but must be one of {names}"
            ) from error
        integer_in("num_envs", num_envs, 1, MAX_COUNT)
        integer_in("threads", threads, 1, 1024)
        if max_episode_steps is not None:
            integer_in("max_episode_steps", max_episode_steps, 1, MAX_COUNT)
        self.settings = Settings(
            task=self.task,
            target=target,
            observation=observation,
            pulse_radius_px=pulse_radius_px,
            max_pulses=max_pulses,
            completion=completion,
            pointing_error_px=pointing_error_px,
            radius_error=radius_error,
            stop_on_miss=stop_on_miss,
        )
        self.metadata = {
            "render_modes": ["rgb_array"],
            "render_fps": 10,
            "autoreset_mode": self.autoreset_mode,
        }
        self.num_envs = num_envs
        self.render_mode = render_mode
        self.single_observation_space = self.settings.observation_space()
        self.single_action_space = self.settings.action_space()
        self.action_space = batched_box(self.single_action_space, num_envs)
        self.max_episode_steps = max_episode_steps
        self.copy = copy
        self.episode_statistics = episode_statistics
        self._native = _native.Batch(
            self.settings.as_native(),
            num_envs,
            self.autoreset_mode.value,
            max_episode_steps,
            threads,
        )
        shape = (num_envs, *self.single_observation_space.shape)
        self._observations = np.zeros(shape, np.uint8)
        same_step = self.autoreset_mode == AutoresetMode.SAME_STEP
        self._final_observations = np.zeros(shape, np.uint8) if same_step else None
        self._seeds = NativeSeeds(num_envs)
        self._started_s = np.zeros(num_envs)
        self._trajectories: list[Trajectory] = []

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
        mask = checked_mask(options.get("reset_mask"), self.num_envs)
        targets = self._targets(options.get("target"))
        if isinstance(seed, (int, np.integer)):
            self._np_random, self._np_random_seed = gym.utils.seeding.np_random(int(seed))
        native_seeds = self._seeds.for_reset(seed, mask)
        mask_list = None if mask is None else mask.tolist()
        self._native.reset(native_seeds, mask_list, self._observations)
        resets = np.ones(self.num_envs, np.bool_) if mask is None else mask
        for index in np.flatnonzero(resets).tolist():
            target = targets[index]
            if target is not None:
                self._native.reset_to(index, target, self._observations)
        self._started_s[resets] = time.perf_counter()
        self._begin_trajectories(resets)
        return self._returned_observations(), self._progress_infos(resets)

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[
        NDArray[np.uint8], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]
    ]:
        """Fires one pulse in every environment.

        Args:
            actions: float32 of shape (num_envs, 2).

        Returns:
            Observations, rewards, terminations, truncations, infos.

        Raises:
            ActionError: Wrong shape or dtype, or a component that is not finite; nothing has
                happened.
            EpisodeOverError: An episode is over and nobody resets it; nothing has happened.
        """
        array = action_array(actions, (self.num_envs, 2))
        self._native.step(array, self._observations, self._final_observations)
        self._follow_pulses()
        terminated, truncated = self._native.terminated(), self._native.truncated()
        infos = self._progress_infos(np.ones(self.num_envs, np.bool_))
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
        return (
            self._returned_observations(),
            self._native.rewards(),
            terminated,
            truncated,
            infos,
        )

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
        return tuple(trajectory.rgb_array() for trajectory in self._trajectories)

    def render_one(self, index: int) -> NDArray[np.uint8] | None:
        """A picture of one environment, see :meth:`render`."""
        return self._trajectories[index].rgb_array() if self._trajectories else None

    def remaining(self, index: int) -> Target:
        """Target pixels of one environment that are not machined yet, Boolean (100, 100)."""
        return self._native.layers(index)[0]

    def forbidden(self, index: int) -> Target:
        """Pristine pixels of one environment that must stay, Boolean (100, 100)."""
        return self._native.layers(index)[1]

    def _begin_trajectories(self, where: NDArray[np.bool_]) -> None:
        """Begins the pictures of new episodes."""
        if self.render_mode is None:
            return
        if not self._trajectories:
            where = np.ones(self.num_envs, np.bool_)
        radius_px = self.settings.pulse_radius_px
        begun = {
            index: Trajectory(self.remaining(index), radius_px)
            for index in np.flatnonzero(where).tolist()
        }
        self._trajectories = [
            begun.get(index) or self._trajectories[index] for index in range(self.num_envs)
        ]

    def _follow_pulses(self) -> None:
        """Adds the pulses of the last step to the pictures."""
        if self.render_mode is None:
            return
        pulses = self._native.last_pulses()
        begun = np.isnan(pulses[:, 0])
        for trajectory, pulse in zip(self._trajectories, pulses.tolist(), strict=True):
            trajectory.add(*pulse)
        self._begin_trajectories(begun)

    def _targets(self, target: Any) -> list[Target | None]:
        """The targets that a reset option names, one for each environment."""
        if target is None:
            return [None] * self.num_envs
        if not isinstance(target, (list, tuple)):
            return [as_target(target)] * self.num_envs
        if len(target) != self.num_envs:
            raise ShapeError(f"{len(target)} targets are given for {self.num_envs} environments")
        return [None if one is None else as_target(one) for one in target]

    def _returned_observations(self) -> NDArray[np.uint8]:
        return self._observations.copy() if self.copy else self._observations

    def _progress_infos(self, where: NDArray[np.bool_]) -> dict[str, Any]:
        """Progress of the episodes that the observations show."""
        infos: dict[str, Any] = {}
        for key, values in zip(_PROGRESS_KEYS, self._native.progress(), strict=True):
            infos[key] = values if where.all() else np.where(where, values, 0)
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
        if self._final_observations is None:
            if terminated.any():
                infos["is_success"] = success & terminated
                infos["_is_success"] = terminated.copy()
            return
        final: dict[str, Any] = {}
        for key, values in zip(_PROGRESS_KEYS, self._native.final_progress(), strict=True):
            final[key] = values
            final[f"_{key}"] = finished.copy()
        if terminated.any():
            final["is_success"] = success & terminated
            final["_is_success"] = terminated.copy()
        observations = np.zeros_like(self._final_observations)
        observations[finished] = self._final_observations[finished]
        infos["final_obs"] = observations
        infos["_final_obs"] = finished.copy()
        infos["final_info"] = final
        infos["_final_info"] = finished.copy()


_PROGRESS_KEYS = ("machined_fraction", "off_target_fraction", "pulses")


class StarVectorEnv(AblationVectorEnv):
    """Vector version of :class:`lasergym.envs.StarEnv`."""

    task = "star"


class RotatedStarVectorEnv(AblationVectorEnv):
    """Vector version of :class:`lasergym.envs.RotatedStarEnv`."""

    task = "rotated-star"


class RandomShapeVectorEnv(AblationVectorEnv):
    """Vector version of :class:`lasergym.envs.RandomShapeEnv`."""

    task = "random-shape"


class PatternVectorEnv(AblationVectorEnv):
    """Vector version of :class:`lasergym.envs.PatternEnv`."""

    task = "pattern"

    def __init__(self, *, target: TargetLike | None = None, **settings: Any) -> None:
        """Makes the environments; see the base class for the arguments."""
        super().__init__(target=_native.star(0.0) if target is None else target, **settings)
