"""Depth milling, spot by spot, as Gymnasium environments."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import ArrayLike, NDArray

from lasergym import _native
from lasergym.envs.milling_settings import MillingObservation, MillingSettings, as_depths
from lasergym.envs.native_env import NativeEnv
from lasergym.envs.native_vector import NativeVectorEnv
from lasergym.envs.settings import action_array
from lasergym.milling import Surface
from lasergym.render import residual_ansi, residual_frame

__all__ = ["MillingEnv", "MillingVectorEnv"]

_PROGRESS_KEYS = ("tracking_error_percent", "machined_fraction", "off_target_fraction", "spots")


class MillingEnv(NativeEnv[NDArray[np.uint8], NDArray[np.float32]]):
    """A depth map, milled spot by spot.

    ## Description
    A beam stands at one place after another of a workpiece of 100 × 100 px and removes material
    there; how deep depends on the dwell, on the footprint of the beam, and, for a waterjet, on the
    slope of the ground. The task is to reach a depth map with few spots. The process is the forward
    model of `lasergym.milling`, after Bilbao-Guillerna et al. (2017).

    ## Action Space
    `Box(-1, 1, (3,), float32)`: position and dwell of the next spot: x = ½ (1 + a₀) side, y = ½
    (1 + a₁) side, x to the right, y down; dwell = ½ (1 + a₂) `longest_dwell_s`. What exceeds
    [-1, 1] is clipped; NaN is an error.

    ## Observation Space
    `observation="residual"`: `Box(0, 255, (1, 100, 100), uint8)`: 128 where the target is reached,
    255 where `depth_um` is left to remove, 1 where the ground is as much too deep.

    `observation="layers"`: `Box(0, 255, (3, 100, 100), uint8)`: what is left to remove, how much
    too deep the ground is (both scaled by `depth_um` to 255), and spots left / `max_spots` (scaled
    to 255) everywhere. But for rounding the process is Markov with it.

    ## Rewards
    The fall of the tracking error Σ|d − d*| / Σ d* (as a part of 1) that the spot causes. The
    return is 1 − the tracking error: what is removed above the target less what is removed below
    it, over the volume of the target.

    ## Starting State
    Flat ground and a new random relief of smooth waves, or the given `target`.

    ## Episode Termination
    The episode terminates when the tracking error is at most `tolerance_percent`, or when
    `max_spots` spots are milled. It is never truncated, except by `max_episode_steps` of
    `gym.make`.

    ## Information
    `tracking_error_percent`, `machined_fraction` (volume removed above the target over the volume
    of the target), `off_target_fraction` (volume removed below the target over the volume of the
    target), `spots`, and at the end `is_success` (within the tolerance).

    ## Arguments
    ```python
    gym.make("lasergym/Milling-v0", process="waterjet-garnet", observation="layers")
    ```
    * `process` (`"laser-graphite"`): `"laser-graphite"`, `"waterjet-garnet"` or a TOML profile.
    * `target`: depths to reach, µm, shape (100, 100) (default: a random relief every episode).
    * `observation`: `"residual"` (default) or `"layers"`.
    * `pixel_um`: side of a pixel, µm (default: a fifteenth of the footprint's reach).
    * `depth_um`: deepest place of random reliefs and full scale of observations, µm (default: half
      of the footprint's reach, or the deepest place of `target`).
    * `longest_dwell_s`: longest dwell of a spot, s (default: what `depth_um` takes in the centre of
      a spot on flat ground).
    * `max_spots` (200): spot budget, at least 1.
    * `tolerance_percent` (2.0): tracking error that ends the episode, %, in [0, 100).
    * `pointing_error_um` (0.0): standard deviation of each spot's displacement along x and along y,
      µm.
    * `dwell_error` (0.0): relative standard deviation of each spot's dwell, in [0, 0.5].
    * `render_mode`: `"rgb_array"`, `"ansi"`, or `"human"` (needs the extra `lasergym[human]`).

    ## Reset Arguments
    `env.reset(options={"target": ...})` mills another target in this episode: depths in µm, shape
    (100, 100).

    ## Version History
    * v0: first version.

    ## References
    A. Bilbao-Guillerna, D. Axinte, J. Billingham, G. Cadot, "Waterjet and laser etching: the
    nonlinear inverse problem", Royal Society Open Science 4 (2017).
    """

    progress_keys = _PROGRESS_KEYS
    as_target = as_depths
    settings: MillingSettings
    _native: _native.MillingEnvironment

    def __init__(
        self,
        *,
        process: str | Path = "laser-graphite",
        target: ArrayLike | None = None,
        observation: MillingObservation = "residual",
        pixel_um: float | None = None,
        depth_um: float | None = None,
        longest_dwell_s: float | None = None,
        max_spots: int = 200,
        tolerance_percent: float = 2.0,
        pointing_error_um: float = 0.0,
        dwell_error: float = 0.0,
        render_mode: str | None = None,
    ) -> None:
        """Makes the environment; see the class for the arguments."""
        settings = MillingSettings(
            process=process,
            target=target,
            observation=observation,
            pixel_um=pixel_um,
            depth_um=depth_um,
            longest_dwell_s=longest_dwell_s,
            max_spots=max_spots,
            tolerance_percent=tolerance_percent,
            pointing_error_um=pointing_error_um,
            dwell_error=dwell_error,
        )
        self._make(settings, _native.MillingEnvironment, render_mode)

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.uint8], float, bool, bool, dict[str, Any]]:
        """Mills one spot.

        Args:
            action: float32 of shape (3,); what exceeds [-1, 1] is clipped.

        Returns:
            Observation, reward, terminated, truncated (always False), info.

        Raises:
            ActionError: The action has the wrong shape or dtype, or is not finite.
            EpisodeOverError: The episode is over or has not begun.
        """
        x, y, dwell = action_array(action, (3,)).tolist()
        reward, terminated, *_ = self._native.step(x, y, dwell)
        return self._stepped(reward, terminated)

    def depth_um(self) -> Surface:
        """The surface as it is now, µm, shape (100, 100)."""
        return self._native.surfaces()[0]

    def target_um(self) -> Surface:
        """The target of this episode, µm, shape (100, 100)."""
        return self._native.surfaces()[1]

    def _text(self) -> str:
        depth_um, target_um = self._native.surfaces()
        error_percent, *_, spots = self._native.progress()
        return residual_ansi(target_um - depth_um, self._full_scale_um(), error_percent, spots)

    def _picture(self) -> NDArray[np.uint8]:
        depth_um, target_um = self._native.surfaces()
        return residual_frame(target_um - depth_um, self._full_scale_um())

    def _full_scale_um(self) -> float:
        return self._native.scales()[1]


class MillingVectorEnv(NativeVectorEnv):
    """Many milling environments, equal to single ones bit for bit.

    ``gym.make_vec("lasergym/Milling-v0", num_envs=64)`` makes it. It takes the arguments of
    :class:`MillingEnv` and those of :class:`lasergym.envs.AblationVectorEnv` that are not of the
    process; ``infos`` are as there, with the keys of :class:`MillingEnv`.
    """

    settings: MillingSettings
    _batch: _native.MillingBatch
    progress_keys = _PROGRESS_KEYS

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
        process: str | Path = "laser-graphite",
        target: ArrayLike | None = None,
        observation: MillingObservation = "residual",
        pixel_um: float | None = None,
        depth_um: float | None = None,
        longest_dwell_s: float | None = None,
        max_spots: int = 200,
        tolerance_percent: float = 2.0,
        pointing_error_um: float = 0.0,
        dwell_error: float = 0.0,
    ) -> None:
        """Makes the environments; see the class for the arguments."""
        super().__init__()
        self.settings = MillingSettings(
            process=process,
            target=target,
            observation=observation,
            pixel_um=pixel_um,
            depth_um=depth_um,
            longest_dwell_s=longest_dwell_s,
            max_spots=max_spots,
            tolerance_percent=tolerance_percent,
            pointing_error_um=pointing_error_um,
            dwell_error=dwell_error,
        )
        self._make(
            lambda *counts: _native.MillingBatch(self.settings.as_native(), *counts),
            num_envs=num_envs,
            max_episode_steps=max_episode_steps,
            autoreset_mode=autoreset_mode,
            threads=threads,
            copy=copy,
            episode_statistics=episode_statistics,
            render_mode=render_mode,
        )

    def render_one(self, index: int) -> NDArray[np.uint8] | None:
        """A picture of one environment, see :meth:`render`."""
        return None if self.render_mode is None else self._frame(index)

    def depth_um(self, index: int) -> Surface:
        """The surface of one environment as it is now, µm, shape (100, 100)."""
        return self._batch.surfaces(index)[0]

    def target_um(self, index: int) -> Surface:
        """The target of one environment, µm, shape (100, 100)."""
        return self._batch.surfaces(index)[1]

    def _frame(self, index: int) -> NDArray[np.uint8]:
        depth_um, target_um = self._batch.surfaces(index)
        return residual_frame(target_um - depth_um, self._batch.full_scale_um())

    def _as_target(self, target: Any) -> Surface:
        """A target as the native batch takes it."""
        return as_depths(target)
