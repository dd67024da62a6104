"""Machine programs: pulses as G-code and CSV, out and in, and the time that they take."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lasergym import _native
from lasergym.planners import positions

__all__ = [
    "GcodeOptions",
    "StageDynamics",
    "Travel",
    "WorkpieceFrame",
    "from_csv",
    "from_gcode",
    "to_csv",
    "to_gcode",
    "travel",
]


@dataclass(frozen=True, kw_only=True)
class WorkpieceFrame:
    """Where the workpiece lies on the machine.

    Attributes:
        origin_x_mm: Machine x of the left edge of the workpiece, mm, from -1000 to 1000.
        origin_y_mm: Machine y of the workpiece's edge of lowest machine y, mm, from -1000 to 1000.
        y_axis: Sense of the machine's y axis; ``"up"`` is usual for machine tools.
        pixel_um: Side of a pixel on the machine, µm; larger ones enlarge the pattern.
    """

    origin_x_mm: float = 0.0
    origin_y_mm: float = 0.0
    y_axis: Literal["up", "down"] = "up"
    pixel_um: float = 1.0

    def as_native(self) -> dict[str, Any]:
        """The frame as the native functions take it."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__}


@dataclass(frozen=True, kw_only=True)
class GcodeOptions:
    """How pulses become a GRBL program.

    Attributes:
        frame: Where the workpiece lies.
        power_s: Laser power as the spindle word S, on the scale of the controller's setting $30.
        dwell_s: Time that the laser is on for one pulse, s, from 0.001 to 3600.
        settling_s: Wait with the laser off between arriving and firing, s, from 0 to 3600.
        feed_mm_min: Feed rate of travel moves, mm/min; None travels as fast as the controller
            allows.
    """

    frame: WorkpieceFrame = WorkpieceFrame()
    power_s: float = 1000.0
    dwell_s: float = 0.05
    settling_s: float = 0.05
    feed_mm_min: float | None = None


@dataclass(frozen=True, kw_only=True)
class StageDynamics:
    """What a motorised stage can do.

    Attributes:
        max_speed_um_s: Highest speed, µm/s.
        acceleration_um_s2: Acceleration, µm/s².
        settling_s: Wait between arriving and firing, s.
        pulse_s: Time for one pulse, s.
    """

    max_speed_um_s: float = 5000.0
    acceleration_um_s2: float = 50000.0
    settling_s: float = 0.05
    pulse_s: float = 0.01


@dataclass(frozen=True)
class Travel:
    """How far and how long a stage travels for a plan.

    Attributes:
        length_um: Length of all moves between pulses, µm.
        time_s: Total time, s: the sum of the following three.
        moving_s: Time in motion, s.
        settling_s: Time for coming to rest, s.
        firing_s: Time for the pulses, s.
    """

    length_um: float
    time_s: float
    moving_s: float
    settling_s: float
    firing_s: float


def to_gcode(
    xy_px: ArrayLike, *, pulse_radius_px: float = 9.0, options: GcodeOptions | None = None
) -> str:
    """Pulses as a GRBL program: laser off first and last, one dwell per pulse.

    Args:
        xy_px: Centres of the pulses in firing order, px; shape (pulses, 2).
        pulse_radius_px: Radius of the marks, px, for the header.
        options: Frame, power and times.

    Raises:
        OptionError: An option is outside its range.
        PositionError: A position is not finite or out of range.
    """
    options = options or GcodeOptions()
    return _native.write_gcode(
        positions(xy_px),
        pulse_radius_px,
        options.frame.as_native(),
        options.power_s,
        options.dwell_s,
        options.settling_s,
        options.feed_mm_min,
    )


def from_gcode(text: str, *, frame: WorkpieceFrame | None = None) -> NDArray[np.float64]:
    """The pulses of a GRBL program: its dwells with the laser on.

    Args:
        text: The program.
        frame: Where the workpiece lies on the machine.

    Returns:
        Centres of the pulses, px; shape (pulses, 2).

    Raises:
        ProgramError: The program has something that is no pulse; the message names the line.
    """
    return _native.read_gcode(text, 1.0, (frame or WorkpieceFrame()).as_native())


def to_csv(xy_px: ArrayLike) -> str:
    """Pulses as CSV with the columns ``pulse,x_um,y_um``."""
    return _native.write_csv(positions(xy_px), 1.0)


def from_csv(text: str) -> NDArray[np.float64]:
    """The pulses of a CSV file of :func:`to_csv`, px; shape (pulses, 2).

    Raises:
        ProgramError: The text is not such a file; the message names the line.
    """
    return _native.read_csv(text, 1.0)


def travel(xy_px: ArrayLike, dynamics: StageDynamics | None = None) -> Travel:
    """How far and how long a stage travels to fire the pulses in order, from the first to the last.

    Raises:
        OptionError: A value of ``dynamics`` is outside its range.
    """
    stage = dynamics or StageDynamics()
    return Travel(
        *_native.travel(
            positions(xy_px),
            stage.max_speed_um_s,
            stage.acceleration_um_s2,
            stage.settling_s,
            stage.pulse_s,
        )
    )
