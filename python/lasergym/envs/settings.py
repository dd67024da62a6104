"""What all pulse-ablation environments have in common: settings, spaces, actions, seeds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypeVar

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from lasergym.errors import ActionNotFiniteError, ActionShapeError, ActionTypeError, OptionError
from lasergym.options import integer_in
from lasergym.targets import SIZE_PX, TargetLike, as_target

__all__ = [
    "MAX_COUNT",
    "ObservationMode",
    "Settings",
    "Task",
    "action_array",
    "batched_box",
    "native_seed",
]

Task: TypeAlias = Literal["star", "rotated-star", "random-shape", "pattern"]
ObservationMode: TypeAlias = Literal["remaining", "layers"]

if TYPE_CHECKING:
    ImageSpace: TypeAlias = gym.spaces.Box[np.uint8]
    ActionSpace: TypeAlias = gym.spaces.Box[np.float32]
    BoxOf = TypeVar("BoxOf", ImageSpace, ActionSpace)

MAX_COUNT = 2**32 - 1
"""Largest number of pulses, steps or environments."""

CHANNELS: dict[str, int] = {"remaining": 1, "layers": 3}


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Task and process settings of an environment; the ranges are checked when it is made.

    Attributes:
        task: Where the targets come from.
        target: The pattern, where the task is ``"pattern"``; may be given as a drawing.
        observation: ``"remaining"`` (1 channel) or ``"layers"`` (3 channels).
        pulse_radius_px: Radius of the disc that one pulse machines, px, in (0, 50].
        max_pulses: Pulses after which the episode terminates, at least 1.
        completion: Machined fraction at which the episode terminates, in (0, 1].
        pointing_error_px: Standard deviation of the displacement of each pulse along x and along y,
            px, in [0, 100].
        radius_error: Relative standard deviation of the pulse radius, in [0, 0.5].
        stop_on_miss: Whether a pulse that machines no target pixel terminates the episode.
    """

    task: Task
    target: TargetLike | None = None
    observation: ObservationMode = "remaining"
    pulse_radius_px: float = 9.0
    max_pulses: int = 45
    completion: float = 0.99
    pointing_error_px: float = 0.0
    radius_error: float = 0.0
    stop_on_miss: bool = False

    def __post_init__(self) -> None:
        """Reads the pattern, which no other task takes."""
        if self.target is None:
            return
        if self.task != "pattern":
            raise OptionError(f"the task {self.task} draws its own targets: leave out `target`")
        object.__setattr__(self, "target", as_target(self.target))

    def as_native(self) -> dict[str, Any]:
        """The settings as keyword arguments of the native environments."""
        integer_in("max_pulses", self.max_pulses, 1, MAX_COUNT)
        return {name: getattr(self, name) for name in self.__dataclass_fields__}

    def observation_space(self) -> ImageSpace:
        """The space of observations: uint8 of shape (channels, 100, 100)."""
        if self.observation not in CHANNELS:
            names = " or ".join(f'"{name}"' for name in CHANNELS)
            raise OptionError(f"observation is {self.observation!r}, but must be {names}")
        return gym.spaces.Box(0, 255, (CHANNELS[self.observation], SIZE_PX, SIZE_PX), np.uint8)

    def action_space(self) -> ActionSpace:
        """The space of actions: [-1, 1]², float32."""
        return gym.spaces.Box(-1.0, 1.0, (2,), np.float32)


def native_seed(np_random: np.random.Generator) -> int:
    """The seed of a native random stream, drawn from Gymnasium's generator."""
    return int(np_random.integers(2**63))


def action_array(action: Any, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """``action`` as float32 of the given shape.

    Raises:
        ActionTypeError: It is not an array of real numbers.
        ActionShapeError: It has another shape.
        ActionNotFiniteError: It has a component that float32 cannot hold.
    """
    array = np.asarray(action)
    if array.dtype.kind not in "fiu":
        raise ActionTypeError(
            f"the action has dtype {array.dtype}, but must be an array of real numbers (float32)"
        )
    if array.shape != shape:
        raise ActionShapeError(f"the action has shape {array.shape}, but must have shape {shape}")
    if array.dtype != np.float32:
        if not (np.abs(array) <= np.finfo(np.float32).max).all():
            raise ActionNotFiniteError("the action has a component that is not a finite float32")
        array = array.astype(np.float32)
    return np.ascontiguousarray(array)


def batched_box(space: BoxOf, count: int) -> BoxOf:
    """The space of ``count`` points of ``space``, equal to ``gymnasium.vector.utils.batch_space``.

    Its bounds are views of those of ``space``. A plain Box holds four arrays of the full shape,
    which for 65 536 images would take 2.6 GB.
    """
    batched = type(space)(space.low[None], space.high[None], dtype=space.dtype.type)
    batched._shape = (count, *space.shape)
    for name in ("low", "high", "bounded_below", "bounded_above"):
        view = np.broadcast_to(getattr(space, name), batched._shape)
        setattr(batched, name, view)
    return batched
