"""What a machine must be able to do: stage, laser and camera.

A driver is any object with these methods. It need not be thread-safe: a job calls each driver from
one thread of its own and gives every call a deadline. A driver says what is wrong by raising one of
:class:`lasergym.errors.DriverError`'s children; any other exception is a fault, too. After a fault
the laser is disarmed and the stage stopped.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

__all__ = ["Camera", "Frame", "Laser", "Stage", "StageLimits"]


@dataclass(frozen=True)
class StageLimits:
    """Where a stage can go.

    Attributes:
        least_um: Lowest x and y, µm.
        most_um: Highest x and y, µm.
    """

    least_um: tuple[float, float]
    most_um: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Frame:
    """A grey frame of a camera.

    Attributes:
        gray: uint8 of shape (height, width), rows from top to bottom.
        taken_at_s: When its exposure began, s, as :func:`time.monotonic` counts.
    """

    gray: NDArray[np.uint8]
    taken_at_s: float


@runtime_checkable
class Stage(Protocol):
    """Carries the workpiece.

    Its position is the point of the workpiece that lies under the laser, µm: x to the right, y
    down, (0, 0) the upper left corner of the pattern. 1 px of a pattern is 1 µm.
    """

    def limits_um(self) -> StageLimits:
        """Where the stage can go, µm; asked once, before a job begins."""

    def move_to(self, x_um: float, y_um: float) -> None:
        """Goes to a position, µm, and returns when it has settled there."""

    def position_um(self) -> tuple[float, float]:
        """Where the encoders say that the stage is, µm: x and y."""

    def home(self) -> None:
        """Finds the origin of the encoders."""

    def stop(self) -> None:
        """Stops at once."""


@runtime_checkable
class Laser(Protocol):
    """Fires single pulses."""

    def arm(self) -> None:
        """Makes the laser ready to fire."""

    def fire(self) -> None:
        """Fires one pulse. When it raises, whether the pulse was fired is unknown."""

    def disarm(self) -> None:
        """Makes the laser safe; harmless where it is safe already."""


@runtime_checkable
class Camera(Protocol):
    """Sees the workpiece while the stage is at the imaging position."""

    def set_exposure_s(self, exposure_s: float) -> None:
        """Sets the exposure time, s, above 0."""

    def frame(self) -> Frame:
        """A frame whose exposure began after the call; always of the same shape."""
