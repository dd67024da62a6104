"""What the environments of robot and scanner have in common: settings, spaces, actions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from lasergym.errors import ActionShapeError, ActionTypeError
from lasergym.options import integer_in

__all__ = ["RemoteScanSettings", "scan_action"]

_DIRECTIONS = 17
_ROBOT_FEATURES = 6
_SUBTASK_FEATURES = 6


@dataclass(frozen=True, kw_only=True)
class RemoteScanSettings:
    """Settings of the environments; the ranges are checked when one is made.

    Attributes:
        subtasks: Number of subtasks, from 1 to 1000.
        area_mm2: Area of the sheet for each of them, mm².
        welded: Part of the subtasks that are welded, in [0, 1].
    """

    subtasks: int = 12
    area_mm2: float = 75_000.0
    welded: float = 0.2

    def __post_init__(self) -> None:
        """Checks the number of subtasks, which the spaces need."""
        integer_in("subtasks", self.subtasks, 1, 1000)

    def as_native(self) -> dict[str, Any]:
        """The settings as keyword arguments of the native environments."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__}

    def observation_space(self) -> gym.spaces.Box[np.float32]:
        """The space of observations."""
        length = _ROBOT_FEATURES + _SUBTASK_FEATURES * self.subtasks
        return gym.spaces.Box(-1.0, 2.0, (length,), np.float32)

    def action_space(self) -> gym.spaces.MultiDiscrete:
        """The space of actions: subtask and direction."""
        return gym.spaces.MultiDiscrete([self.subtasks, _DIRECTIONS])


def scan_action(action: Any, shape: tuple[int, ...]) -> NDArray[np.int64]:
    """``action`` as int64 of the given shape.

    Raises:
        ActionTypeError: It is not an array of integers.
        ActionShapeError: It has another shape.
    """
    array = np.asarray(action)
    if array.dtype.kind not in "iu":
        raise ActionTypeError(f"the action has dtype {array.dtype}, but must be integers (int64)")
    if array.shape != shape:
        raise ActionShapeError(f"the action has shape {array.shape}, but must have shape {shape}")
    return np.ascontiguousarray(array, dtype=np.int64)
