"""Scan heads: their dynamics, calibration from test lines, and the adaptive postprocessor.

Source: Penchev et al., "Beam deflectors' dynamics: adaptive postprocessor". Positions are µm with y
up, times µs, speeds m/s.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from lasergym import _native
from lasergym.cma_es import CmaEs
from lasergym.errors import OptionError
from lasergym.options import integer_in

__all__ = [
    "DIALECTS",
    "HEADS",
    "AxisCalibration",
    "Calibration",
    "Compensation",
    "Identification",
    "Judgement",
    "LineOutcomes",
    "MeasuredLine",
    "Regression",
    "Tuning",
    "calibrate",
    "compensation",
    "head_text",
    "identify",
    "line_pattern",
    "machine_lines",
    "measure_line",
    "postprocess",
    "simulate",
    "tune",
]

_SHIPPED: dict[str, str] = dict(_native.galvo_heads())

HEADS: tuple[str, ...] = tuple(_SHIPPED)
"""Names of the shipped heads; all have the lag of Penchev et al., 216.4 µs."""

DIALECTS: tuple[str, ...] = ("grbl", "linuxcnc", "mach4", "rtc", "rtc-micro-vectors")
"""What programs are written as: G-code of three controllers, or a list of RTC commands or of
micro-vectors as CSV."""

Method: TypeAlias = Literal["adaptive", "delays", "none"]
"""How strokes are compensated: offsets and delays, delays only, not at all."""

_STROKE_COLUMNS = (
    "stroke",
    "pulses",
    "speed_m_s",
    "start_error_um",
    "end_error_um",
    "length_error_um",
    "pitch_min",
    "pitch_max",
    "lateral_error_um",
)


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
class Compensation:
    """Offsets and delays of a stroke at one speed.

    Attributes:
        run_in_um: By how much the stroke begins earlier, µm.
        run_out_um: By how much it ends later, µm.
        on_us: From the start of the extended stroke to the first pulse, µs.
        off_us: From the end of the extended stroke to the last pulse, µs.
        lag_us: Lag of the head, µs.
        settling_us: Time in which the head settles beyond its lag, µs.
        lateral_um: How far strokes are commanded to the left of where they are drawn, µm.
    """

    run_in_um: float
    run_out_um: float
    on_us: float
    off_us: float
    lag_us: float
    settling_us: float
    lateral_um: float


@dataclass(frozen=True, eq=False)
class Judgement:
    """What a program makes on a head.

    Attributes:
        figures: The figures of the report by name; pitches are 1 where pulses are as far apart as
            speed and rate say; None where there was nothing to measure.
        strokes: A structured array with a row for each stroke.
        box_um: Low and high corner of what is marked, x, y, x, y, µm, with a map only.
        energy: Pulses that hit each cell, shape (rows, columns), y up, with a map only.
        picture: The map as the bytes of a PNG file, with a map only.
    """

    figures: dict[str, float | None]
    strokes: NDArray[Any]
    box_um: tuple[float, float, float, float] | None
    energy: NDArray[np.float32] | None
    picture: bytes | None

    def __getattr__(self, name: str) -> float | None:
        """A figure as an attribute, such as ``length_error_um_max``."""
        if name != "figures" and name in self.figures:
            return self.figures[name]
        raise AttributeError(f"a Judgement has no {name!r}")

    def as_dict(self) -> dict[str, Any]:
        """The figures as a JSON report holds them."""
        return dict(self.figures)


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


@dataclass(frozen=True, eq=False)
class LineOutcomes:
    """What lines come out as; arrays with a value for each line.

    Attributes:
        cost: Edges, pitch and time in their scales, added up.
        start_error_um: How far the first crater's edge lies beyond the drawn start, µm.
        end_error_um: How far the last crater's edge lies beyond the drawn end, µm.
        lateral_error_um: Largest distance of a pulse from the drawn line, µm.
        pitch_deviation: Largest deviation of pulse distances from those that speed and rate say.
        time_us: Time of the whole stroke, µs.
    """

    cost: NDArray[np.float64]
    start_error_um: NDArray[np.float64]
    end_error_um: NDArray[np.float64]
    lateral_error_um: NDArray[np.float64]
    pitch_deviation: NDArray[np.float64]
    time_us: NDArray[np.float64]


@dataclass(frozen=True)
class Tuning:
    """Offsets and delays found by CMA-ES.

    Attributes:
        speed_m_s: Speed that they are for, m/s.
        correction_us: What is added to the formulas, µs: longer run-in, longer run-out, later first
            pulse, later last pulse, larger lag of y than of x.
        run_in_um: By how much long strokes along x begin earlier, µm.
        run_out_um: By how much they end later, µm.
        on_us: From the start of the extended stroke to the first pulse, µs.
        off_us: From the end of the extended stroke to the last pulse, µs.
        settling_us: From the start of a stroke until the head moves evenly, by the formulas, µs.
        cost: What the lines cost with them.
        formula_cost: What they cost with the offsets and delays of the formulas.
    """

    speed_m_s: float
    correction_us: tuple[float, float, float, float, float]
    run_in_um: float
    run_out_um: float
    on_us: float
    off_us: float
    settling_us: float
    cost: float
    formula_cost: float

    @property
    def offsets(self) -> tuple[float, float, float, float]:
        """Run-in, run-out and delays as :func:`postprocess` takes them for all strokes."""
        return (self.run_in_um, self.run_out_um, self.on_us, self.off_us)

    @property
    def toml(self) -> str:
        """The correction as an entry ``[[correction]]`` of a head file."""
        names = ("run_in_us", "run_out_us", "on_us", "off_us", "skew_us")
        times = ", ".join(
            f"{name} = {value!r}" for name, value in zip(names, self.correction_us, strict=True)
        )
        return f"[[correction]]\nspeed_m_s = {self.speed_m_s!r}\ntimes = {{ {times} }}\n"

    @property
    def delays_toml(self) -> str:
        """The delays as the section ``[controller.delays]`` of a head file; waits in 10 µs."""
        wait_us = 10.0 * math.ceil(0.1 * self.settling_us)
        delays = {
            "jump_us": wait_us,
            "mark_us": max(wait_us, 10.0 * math.ceil(0.1 * self.off_us)),
            "laser_on_us": round(2.0 * self.on_us) / 2.0,
            "laser_off_us": round(2.0 * self.off_us) / 2.0,
        }
        lines = "".join(f"{name} = {value!r}\n" for name, value in delays.items())
        return f"[controller.delays]\n{lines}"


def head_text(head: str | Path) -> str:
    """The TOML text of a shipped head or of a head file.

    Raises:
        OptionError: There is neither a head nor a file of that name.
    """
    if str(head) in _SHIPPED:
        return _SHIPPED[str(head)]
    path = Path(head)
    if not path.is_file():
        raise OptionError(
            f"there is no head named {str(head)!r}: use one of {', '.join(HEADS)}, or the name of "
            "a TOML file"
        )
    text = path.read_text(encoding="utf-8", errors="replace")
    _native.galvo_head(text)
    return text


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


def compensation(
    head: str | Path = "bessel",
    *,
    speed_m_s: float,
    angle_deg: float = 0.0,
    length_um: float | None = None,
    beam_um: float = 40.0,
    tolerance: float = 0.02,
    method: Method = "adaptive",
) -> Compensation:
    """Offsets and delays of straight strokes at a speed.

    Args:
        head: Name of a shipped head or of a TOML file. Its ``[calibration]`` is used where there is
            one, otherwise the model of its axes.
        speed_m_s: Speed, m/s.
        angle_deg: Direction, degrees from x towards y; matters where the axes differ.
        length_um: Length, µm; by default so long that the start is forgotten at the end.
        beam_um: Crater diameter by which strokes are shortened, µm.
        tolerance: Part by which pulses may be nearer or farther apart (models only).
        method: Which compensation.

    Raises:
        OptionError, GalvoError: An option is outside its range.
    """
    line = (speed_m_s, math.radians(angle_deg), length_um)
    return Compensation(
        *_native.galvo_compensation(head_text(head), method, line, beam_um, tolerance)
    )


def postprocess(
    job: str | Path,
    program: str | Path,
    *,
    head: str | Path = "bessel",
    dialect: str = "grbl",
    method: Method = "adaptive",
    speed_m_s: float | None = None,
    beam_um: float = 40.0,
    pitch_um: float | None = None,
    tolerance: float = 0.02,
    corner_deg: float = 10.0,
    control: Literal["delays", "inline"] = "delays",
    grid: Literal["fit", "keep"] = "fit",
    delay_step_us: float = 0.5,
    jump_delay_us: float | None = None,
    mark_delay_us: float | None = None,
    power: float = 255.0,
    offsets: tuple[float, float, float, float] | None = None,
    step_us: int = 10,
    origin_um: tuple[float, float] = (0.0, 0.0),
) -> int:
    """Turns a job into a program whose strokes come out as drawn.

    Args:
        job: A cutter-location file (.apt, .cl, .cls), G-code (.nc, .gcode, .ngc, .tap) or a table
            (.csv) of passes as ``lasergym mill`` or of pulses as ``lasergym plan`` writes it.
            Tables count y downwards: (x, y) becomes (x, −y). A pulse, also a dwell with the laser
            on in G-code, becomes a stroke that fires once; it needs ``speed_m_s``.
        program: The file to write.
        head: Name of a shipped head or of a TOML file, with its calibration.
        dialect: One of :data:`DIALECTS`.
        method: Which compensation.
        speed_m_s: Speed of all vectors, m/s; by default those of the job.
        beam_um: Crater diameter by which strokes are shortened, µm.
        pitch_um: Distance of pulses, µm; by default that of the head's pulse rate.
        tolerance: Part by which pulses may be nearer or farther apart.
        corner_deg: Vectors that meet at a larger turn become separate strokes, degrees.
        control: ``"delays"``: the controller switches the laser by delays, which the program's
            header holds; ``"inline"``: the program switches it itself.
        grid: ``"fit"``: the pulse rate is adjusted to the length of a stroke; ``"keep"``: it stays,
            and ends are met within half a pitch.
        delay_step_us: Laser delays are multiples of this, µs.
        jump_delay_us: Wait after jumps, µs; by default run-in time and lag.
        mark_delay_us: Wait after strokes, µs; by default the lag.
        power: The word S of lit vectors, Q from 0 to 255 for Mach4.
        offsets: Run-in µm, run-out µm, laser on µs, laser off µs to use instead.
        step_us: Time between micro-vectors, µs, a multiple of 10 up to 1000.
        origin_um: Where the origin of the job lies in the field of the head, µm.

    Returns:
        The number of vectors.

    Raises:
        ProgramError: The job cannot be read; the message has line, column and reason.
        OptionError, GalvoError: An option is outside its range, or the job leaves the field.
    """
    settings = {
        "method": method,
        "speed_m_s": speed_m_s,
        "beam_um": beam_um,
        "pitch_um": pitch_um,
        "tolerance": tolerance,
        "corner_deg": corner_deg,
        "control": control,
        "grid": grid,
        "delay_step_us": delay_step_us,
        "jump_delay_us": jump_delay_us,
        "mark_delay_us": mark_delay_us,
        "fixed": offsets,
        "origin_um": origin_um,
        "step_us": integer_in("step_us", step_us, 10, 1000),
    }
    return _native.galvo_postprocess(
        head_text(head), str(job), str(program), settings, dialect, power
    )


def simulate(
    program: str | Path, *, head: str | Path = "bessel", map_px: int | None = None
) -> Judgement:
    """Runs a program on a simulated head and judges what it makes.

    Args:
        program: G-code, ours or foreign, or a list of RTC commands or micro-vectors (.csv).
        head: Name of a shipped head or of a TOML file.
        map_px: Cells of the energy map along its longer side, from 16 to 4000; by default no map.

    Raises:
        ProgramError: The program cannot be read; the message has line, column and reason.
        OptionError, GalvoError: It has settings out of range, or leaves the field.
    """
    cells = None if map_px is None else integer_in("map_px", map_px, 16, 4000)
    figures, rows, box_um, mapped = _native.galvo_simulate(head_text(head), str(program), cells)
    strokes = np.zeros(len(rows), [(name, np.float64) for name in _STROKE_COLUMNS])
    for index, name in enumerate(_STROKE_COLUMNS):
        strokes[name] = rows[:, index]
    known = {name: value if math.isfinite(value) else None for name, value in figures}
    energy, picture = (None, None) if mapped is None else mapped
    return Judgement(known, strokes, box_um, energy, picture)


def machine_lines(
    head: str | Path = "bessel",
    *,
    speed_m_s: float,
    lines: Sequence[tuple[float, float]],
    known: str | Path | None = None,
    correction_us: Sequence[float] = (0.0, 0.0, 0.0, 0.0, 0.0),
    beam_um: float = 40.0,
    pitch_um: float = 20.0,
    tolerance: float = 0.02,
    delays_only: bool = False,
    edge_scale_um: float = 10.0,
    pitch_scale: float = 0.05,
    time_scale_us: float = 2000.0,
) -> LineOutcomes:
    """Machines straight lines, each from rest, with the formulas and a correction of them.

    Args:
        head: Name of a shipped head or of a TOML file; its axes and laser are simulated.
        speed_m_s: Speed, m/s.
        lines: Length, µm, and direction, degrees, of each.
        known: The head that the formulas know, with its calibration; by default ``head`` itself.
        correction_us: What is added to the formulas, as in :class:`Tuning`.
        beam_um: Crater diameter, µm.
        pitch_um: Distance of pulses, µm.
        tolerance: Part by which pulses may be nearer or farther apart (formulas of models).
        delays_only: Keep run-in and run-out at 0, for those who cannot postprocess.
        edge_scale_um: Sum of both edge errors and the distance beside the line that costs 1, µm.
        pitch_scale: Deviation of the pitch that costs 1.
        time_scale_us: Time beyond that of the drawn line that costs 1, µs.

    Raises:
        OptionError, GalvoError: An option is outside its range.
    """
    native = _line_set(
        (head, head if known is None else known),
        "delays" if delays_only else "adaptive",
        (speed_m_s, beam_um, pitch_um, tolerance),
        (edge_scale_um, pitch_scale, time_scale_us),
        lines,
    )
    rows = np.array(native.outcomes([float(time) for time in correction_us]))
    return LineOutcomes(*rows.reshape(-1, 6).T)


def _line_set(
    heads: tuple[str | Path, str | Path],
    method: Method,
    kind: tuple[float, float, float, float],
    scales: tuple[float, float, float],
    lines: Sequence[tuple[float, float]],
) -> _native.GalvoLineSet:
    if not lines:
        raise OptionError("there are no lines: give at least one length and one angle")
    turned = [(float(length), math.radians(angle)) for length, angle in lines]
    plant, known = (head_text(head) for head in heads)
    return _native.GalvoLineSet(plant, known, method, kind, scales, turned)


def tune(
    head: str | Path = "bessel",
    *,
    speed_m_s: float,
    known: str | Path | None = None,
    lengths_um: Sequence[float] = (80.0, 400.0, 2000.0),
    angles_deg: Sequence[float] = (0.0, 35.0, 90.0),
    beam_um: float = 40.0,
    pitch_um: float = 20.0,
    tolerance: float = 0.02,
    delays_only: bool = False,
    edge_scale_um: float = 10.0,
    pitch_scale: float = 0.05,
    time_scale_us: float = 2000.0,
    evaluations: int = 800,
    seed: int = 0,
) -> Tuning:
    """Finds what to add to the formulas, for lines at one speed, by CMA-ES on a simulated head.

    The cost of a line is (|start error| + |end error| + distance beside it)/``edge_scale_um`` +
    largest |pitch - 1|/``pitch_scale`` + time beyond that of the drawn line/``time_scale_us``;
    that of a correction is the mean over lines of all lengths in all directions. No correction is
    one of the candidates, so that the result is never worse on these lines.

    Args:
        head: Name of a shipped head or of a TOML file; its axes and laser are simulated.
        speed_m_s: Speed, m/s.
        known: The head that the formulas know, with its calibration; by default ``head`` itself.
        lengths_um: Lengths of the lines, µm.
        angles_deg: Directions of the lines, degrees.
        beam_um: Crater diameter, µm.
        pitch_um: Distance of pulses, µm.
        tolerance: Part by which pulses may be nearer or farther apart (formulas of models).
        delays_only: Keep run-in and run-out at 0, for those who cannot postprocess.
        edge_scale_um: Sum of both edge errors and the distance beside the line that costs 1, µm.
        pitch_scale: Deviation of the pitch that costs 1.
        time_scale_us: Time beyond that of the drawn line that costs 1, µs.
        evaluations: Corrections that are tried at most; each costs all lines.
        seed: Seed of the search.

    Raises:
        OptionError, GalvoError: An option is outside its range.
    """
    knows = head if known is None else known
    method: Method = "delays" if delays_only else "adaptive"
    native = _line_set(
        (head, knows),
        method,
        (speed_m_s, beam_um, pitch_um, tolerance),
        (edge_scale_um, pitch_scale, time_scale_us),
        [(length, angle) for length in lengths_um for angle in angles_deg],
    )
    start = compensation(
        knows, speed_m_s=speed_m_s, beam_um=beam_um, tolerance=tolerance, method=method
    )
    # In lags, so that one step size fits all heads. Of delays alone only the laser's are free.
    size = max(start.lag_us, 1.0)
    free = np.array([not delays_only] * 2 + [True] * 2 + [not delays_only])

    def costs(candidates: NDArray[np.float64]) -> NDArray[np.float64]:
        rows = np.zeros((len(candidates), free.size))
        rows[:, free] = candidates * size
        return np.array(native.costs(rows.tolist()))

    none = np.zeros(int(free.sum()))
    formula_cost = float(costs(none[None])[0])
    search = CmaEs(none, 0.05, seed=seed, max_evaluations=evaluations)
    while search.termination is None:
        search.tell(costs(search.ask()))
    correction, cost = np.zeros(free.size), formula_cost
    if search.best_cost < formula_cost:
        correction[free], cost = search.best_x * size, search.best_cost
    run_in_us, run_out_us, on_us, off_us, skew_us = correction.tolist()
    if delays_only:
        run_in_um, run_out_um = 0.0, 0.0
    else:
        run_in_um = max(start.run_in_um + speed_m_s * run_in_us, 0.0)
        run_out_um = max(start.run_out_um + speed_m_s * run_out_us, 0.0)
    return Tuning(
        speed_m_s,
        (run_in_us, run_out_us, on_us, off_us, skew_us),
        run_in_um,
        run_out_um,
        start.on_us + (run_in_um - start.run_in_um) / speed_m_s + on_us,
        start.off_us - (run_out_um - start.run_out_um) / speed_m_s + off_us,
        start.settling_us + start.lag_us,
        cost,
        formula_cost,
    )
