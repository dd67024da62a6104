"""What measured lines and trajectories say of a scan head."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lasergym import _native
from lasergym.galvo.heads import head_text
from lasergym.options import integer_in

__all__ = [
    "AxisCalibration",
    "Calibration",
    "Identification",
    "MeasuredLine",
    "Regression",
    "calibrate",
    "identify",
    "line_pattern",
    "measure_line",
]


@dataclass(frozen=True)
class Regression:
    """A length against speed: intercept + slope × speed, or linear between means where that is off.

    Attributes:
        intercept_um: Length at speed 0, µm.
        slope_us: Length per speed, µm per m/s, which are µs.
        intercept_confidence_95: Half-width of the 95 % interval of the intercept, µm.
        slope_confidence_95: Half-width of the 95 % interval of the slope, µs.
        rms_um: Root mean square of what the line leaves, µm.
        means: Speed m/s, mean length µm, and half-width of its 95 % interval (None with one line)
            of each speed where the straight line leaves more than 5 µm; otherwise empty.
    """

    intercept_um: float
    slope_us: float
    intercept_confidence_95: float
    slope_confidence_95: float
    rms_um: float
    means: tuple[tuple[float, float, float | None], ...] = ()

    def at_um(self, speed_m_s: float) -> float:
        """The length at a speed, µm; in proportion to the speed below the slowest mean."""
        if len(self.means) < 2:
            return self.intercept_um + self.slope_us * speed_m_s
        speeds = [speed for speed, _, _ in self.means]
        lengths = [length for _, length, _ in self.means]
        if speed_m_s > speeds[-1]:
            slope = (lengths[-1] - lengths[-2]) / (speeds[-1] - speeds[-2])
            return lengths[-1] + slope * (speed_m_s - speeds[-1])
        return float(np.interp(speed_m_s, [0.0, *speeds], [0.0, *lengths]))


@dataclass(frozen=True)
class AxisCalibration:
    """What test lines say of one axis.

    Attributes:
        lag: What lines are too short, centre to centre.
        acceleration: Length over which the mirror takes up its speed.
        lead: How far the mirror is ahead of its steady lag at the end of that length; None where
            acceleration times were not measured.
    """

    lag: Regression
    acceleration: Regression
    lead: Regression | None

    def as_dict(self) -> dict[str, Any]:
        """The figures as a JSON report holds them."""
        parts = {"lag": self.lag, "acceleration": self.acceleration, "lead": self.lead}
        return {name: asdict(of) for name, of in parts.items() if of is not None}


@dataclass(frozen=True)
class Calibration:
    """What test lines say of a head.

    Attributes:
        x: Of the axis that moves along x.
        y: Of the axis that moves along y.
        toml: The section ``[calibration]`` of a head file.
    """

    x: AxisCalibration
    y: AxisCalibration
    toml: str

    @property
    def lag(self) -> Regression:
        """The lag of x, which is that of both where lines do not tell their axis."""
        return self.x.lag

    @property
    def acceleration(self) -> Regression:
        """The acceleration length of x, or of both."""
        return self.x.acceleration

    def as_dict(self) -> dict[str, Any]:
        """The figures as a JSON report holds them."""
        if self.x == self.y:
            return self.x.as_dict()
        return {"x": self.x.as_dict(), "y": self.y.as_dict()}


class MeasuredLine(NamedTuple):
    """What is measured on a line that was machined without compensation."""

    measured_um: float
    """From the first to the last crater's centre, µm."""
    acceleration_um: float
    """Acceleration length, µm."""
    acceleration_time_us: float
    """From the first crater to its end, µs."""


@dataclass(frozen=True)
class Identification:
    """A model of an axis, fitted to a recorded trajectory.

    Attributes:
        family: ``"bessel"``, ``"second-order"`` or ``"acceleration-time"``, each with a dead time.
        parameters: Name, value and half-width of the 95 % interval of each parameter.
        rms_um: Root mean square distance between measured and modelled positions, µm.
        toml: The section ``[axis]`` of a head file.
    """

    family: str
    parameters: tuple[tuple[str, float, float], ...]
    rms_um: float
    toml: str


def calibrate(lines: str | Path) -> Calibration:
    """Fits lag and acceleration length to measured test lines.

    Args:
        lines: Name of a CSV file with the columns
            ``speed_m_s,nominal_um,measured_um,acceleration_um``; three lines or more at two speeds
            or more, measured from crater centre to crater centre. Columns ``axis`` (x or y: each
            axis is fitted to its own lines) and ``acceleration_time_us`` (craters within the
            acceleration length times the pulse period: the start is met exactly) may follow.

    Raises:
        GalvoError: The file cannot be read, or does not determine the regressions.
    """
    text = Path(lines).read_text(encoding="utf-8", errors="replace")
    toml, axes = _native.galvo_calibrate(text)
    x, y = (
        AxisCalibration(
            _regression(lag), _regression(acceleration), None if lead is None else _regression(lead)
        )
        for lag, acceleration, lead in axes
    )
    return Calibration(x, y, toml)


def _regression(
    row: tuple[Sequence[float], Sequence[tuple[float, float, float | None]]],
) -> Regression:
    (intercept_um, slope_us, intercept_width, slope_width, rms_um), means = row
    return Regression(intercept_um, slope_us, intercept_width, slope_width, rms_um, tuple(means))


def identify(trajectory: str | Path, *, family: str = "best") -> Identification:
    """Fits a model of an axis to a recorded trajectory, by least squares.

    Args:
        trajectory: Name of a CSV file with the columns ``time_us,command_um,position_um``, from
            rest on; the command is linear between samples.
        family: ``"best"`` of all, or the name of one.

    Raises:
        GalvoError: The file cannot be read, or does not determine a model.
    """
    text = Path(trajectory).read_text(encoding="utf-8", errors="replace")
    name, toml, parameters, rms_um = _native.galvo_identify(text, family)
    return Identification(name, tuple(parameters), rms_um, toml)


def line_pattern(
    speeds_m_s: Sequence[float] = (0.5, 1.0, 1.5, 2.0),
    *,
    length_um: float = 2000.0,
    repeats: int = 10,
    spacing_um: float = 100.0,
) -> str:
    """The test lines to machine without compensation and to measure, as a cutter-location file.

    Args:
        speeds_m_s: Speeds, m/s.
        length_um: Length of each line, µm.
        repeats: Lines at each speed along x, and as many along y.
        spacing_um: Distance of neighbouring lines, µm.

    Raises:
        OptionError: An option is outside its range.
    """
    count = integer_in("repeats", repeats, 1, 1000)
    return _native.galvo_test_pattern([float(s) for s in speeds_m_s], length_um, count, spacing_um)


def measure_line(
    head: str | Path = "bessel",
    *,
    speed_m_s: float,
    length_um: float = 2000.0,
    angle_deg: float = 0.0,
    tolerance: float = 0.02,
) -> MeasuredLine:
    """Machines a line on a simulated head without compensation, and measures it.

    Args:
        head: Name of a shipped head or of a TOML file.
        speed_m_s: Speed, m/s.
        length_um: Length as drawn, µm.
        angle_deg: Direction, degrees from x towards y.
        tolerance: The acceleration length ends where the speed stays within this part.

    Returns:
        Length from the first to the last crater's centre, acceleration length, and its time.

    Raises:
        OptionError, GalvoError: An option is outside its range.
    """
    text = head_text(head)
    return MeasuredLine(
        *_native.galvo_measure_line(text, speed_m_s, length_um, math.radians(angle_deg), tolerance)
    )
