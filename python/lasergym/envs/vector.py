"""Many pulse-ablation environments at once, stepped by native code."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from lasergym import _native
from lasergym.envs.native_vector import NativeVectorEnv
from lasergym.envs.settings import ObservationMode, Settings, Task
from lasergym.render import Trajectory
from lasergym.targets import Target, TargetLike, as_target

__all__ = [
    "AblationVectorEnv",
    "PatternVectorEnv",
    "RandomShapeVectorEnv",
    "RotatedStarVectorEnv",
    "StarVectorEnv",
]


class AblationVectorEnv(NativeVectorEnv):
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
    settings: Settings
    _batch: _native.Batch
    progress_keys = ("machined_fraction", "off_target_fraction", "pulses")

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
        self._make(
            lambda *counts: _native.Batch(self.settings.as_native(), *counts),
            num_envs=num_envs,
            max_episode_steps=max_episode_steps,
            autoreset_mode=autoreset_mode,
            threads=threads,
            copy=copy,
            episode_statistics=episode_statistics,
            render_mode=render_mode,
        )
        self._trajectories: list[Trajectory] = []

    def render_one(self, index: int) -> NDArray[np.uint8] | None:
        """A picture of one environment, see :meth:`render`."""
        return self._trajectories[index].rgb_array() if self._trajectories else None

    def remaining(self, index: int) -> Target:
        """Target pixels of one environment that are not machined yet, Boolean (100, 100)."""
        return self._batch.layers(index)[0]

    def forbidden(self, index: int) -> Target:
        """Pristine pixels of one environment that must stay, Boolean (100, 100)."""
        return self._batch.layers(index)[1]

    def _after_reset(self, where: NDArray[np.bool_]) -> None:
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

    def _after_step(self) -> None:
        """Adds the pulses of the last step to the pictures."""
        if self.render_mode is None:
            return
        pulses = self._batch.last_pulses()
        begun = np.isnan(pulses[:, 0])
        for trajectory, pulse in zip(self._trajectories, pulses.tolist(), strict=True):
            trajectory.add(*pulse)
        self._after_reset(begun)

    def _as_target(self, target: Any) -> Target:
        """A target as the native batch takes it."""
        return as_target(target)


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
