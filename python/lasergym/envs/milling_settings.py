"""Settings of the milling environments."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike

from lasergym.envs.settings import MAX_COUNT
from lasergym.errors import DepthMapError, OptionError
from lasergym.milling import Surface, profile_text
from lasergym.options import integer_in
from lasergym.targets import SIZE_PX

if TYPE_CHECKING:
    from lasergym.envs.settings import ActionSpace, ImageSpace

__all__ = ["MillingObservation", "MillingSettings", "as_depths"]

MillingObservation: TypeAlias = Literal["residual", "layers"]

_CHANNELS: dict[str, int] = {"residual": 1, "layers": 3}


@dataclass(frozen=True, kw_only=True)
class MillingSettings:
    """Settings of a milling environment; the ranges are checked when it is made.

    Attributes:
        process: Name of a shipped profile or of a TOML file.
        target: Depths to reach, µm, shape (100, 100); None: a new random relief every episode.
        observation: ``"residual"`` (1 channel) or ``"layers"`` (3 channels).
        pixel_um: Side of a pixel, µm; None: a fifteenth of the footprint's reach.
        depth_um: Depth of the deepest place of random reliefs and full scale of observations, µm;
            None: half of the footprint's reach, or the deepest place of ``target``.
        longest_dwell_s: Longest dwell of a spot, s; None: what ``depth_um`` takes on flat ground.
        max_spots: Spots after which the episode terminates, at least 1.
        tolerance_percent: Tracking error that ends the episode as a success, %, in [0, 100).
        pointing_error_um: Standard deviation of the displacement of each spot along x and along y,
            µm.
        dwell_error: Relative standard deviation of the dwell, in [0, 0.5].
    """

    process: str | Path = "laser-graphite"
    target: ArrayLike | None = None
    observation: MillingObservation = "residual"
    pixel_um: float | None = None
    depth_um: float | None = None
    longest_dwell_s: float | None = None
    max_spots: int = 200
    tolerance_percent: float = 2.0
    pointing_error_um: float = 0.0
    dwell_error: float = 0.0

    def __post_init__(self) -> None:
        """Turns the target into an array."""
        if self.target is not None:
            object.__setattr__(self, "target", as_depths(self.target))

    def as_native(self) -> dict[str, Any]:
        """The settings as keyword arguments of the native environments."""
        integer_in("max_spots", self.max_spots, 1, MAX_COUNT)
        arguments = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return {"profile": profile_text(arguments.pop("process")), **arguments}

    def observation_space(self) -> ImageSpace:
        """The space of observations: uint8 of shape (channels, 100, 100)."""
        if self.observation not in _CHANNELS:
            names = " or ".join(f'"{name}"' for name in _CHANNELS)
            raise OptionError(f"observation is {self.observation!r}, but must be {names}")
        return gym.spaces.Box(0, 255, (_CHANNELS[self.observation], SIZE_PX, SIZE_PX), np.uint8)

    def action_space(self) -> ActionSpace:
        """The space of actions: [-1, 1]³, float32."""
        return gym.spaces.Box(-1.0, 1.0, (3,), np.float32)


def as_depths(target: Any) -> Surface:
    """Depths as float64 of shape (100, 100), µm.

    Raises:
        DepthMapError: They are not numbers or have another shape.
    """
    try:
        array = np.asarray(target, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise DepthMapError(f"the target has values that are not numbers: {error}") from error
    if array.shape != (SIZE_PX, SIZE_PX):
        raise DepthMapError(f"the target has shape {array.shape}, but must have shape (100, 100)")
    return np.ascontiguousarray(array)
