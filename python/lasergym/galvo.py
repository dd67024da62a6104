"""Scan heads: their dynamics, calibration from test lines, and the adaptive postprocessor.

Source: Penchev et al., "Beam deflectors' dynamics: adaptive postprocessor". Positions are µm with y
up, times µs, speeds m/s.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from lasergym import _native
from lasergym.cma_es import CmaEs
from lasergym.errors import OptionError
from lasergym.options import integer_in

__all__ = [
    "DIALECTS",
    "HEADS",
    "Calibration",
    "Compensation",
    "Identification",
    "Judgement",
    "Regression",
    "Tuning",
    "calibrate",
    "compensation",
    "head_text",
    "identify",
    "line_pattern",
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
)


@dataclass(frozen=True)
class Regression:
    """A length that grows linearly with speed: intercept + slope × speed.

    Attributes:
        intercept_um: Length at speed 0, µm.
        slope_us: Length per speed, µm per m/s, which are µs.
        intercept_confidence_95: Half-width of the 95 % interval of the intercept, µm.
        slope_confidence_95: Half-width of the 95 % interval of the slope, µs.
        rms_um: Root mean square of what the line leaves, µm.
    """

    intercept_um: float
    slope_us: float
    intercept_confidence_95: float
    slope_confidence_95: float
    rms_um: float

    def at_um(self, speed_m_s: float) -> float:
        """The length at a speed, µm."""
        return max(self.intercept_um + self.slope_us * speed_m_s, 0.0)


@dataclass(frozen=True)
class Calibration:
    """What test lines say of a head.

    Attributes:
        lag: What lines are too short, centre to centre.
        acceleration: Length over which the mirror takes up its speed.
        toml: The section ``[calibration]`` of a head file.
    """

    lag: Regression
    acceleration: Regression
    toml: str

    def as_dict(self) -> dict[str, Any]:
        """The figures as a JSON report holds them."""
        return {
            name: {key: getattr(of, key) for key in of.__dataclass_fields__}
            for name, of in (("lag", self.lag), ("acceleration", self.acceleration))
        }


@dataclass(frozen=True)
class Compensation:
    """Offsets and delays of a stroke at one speed.

    Attributes:
        run_in_um: By how much the stroke begins earlier, µm.
        run_out_um: By how much it ends later, µm.
        on_us: From the start of the extended stroke to the first pulse, µs.
        off_us: From the end of the extended stroke to the last pulse, µs.
        lag_us: Lag of the head, µs.
        settling_us: Run-in over speed, µs.
    """

    run_in_um: float
    run_out_um: float
    on_us: float
    off_us: float
    lag_us: float
    settling_us: float


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


@dataclass(frozen=True)
class Tuning:
    """Offsets and delays found by CMA-ES.

    Attributes:
        run_in_um: By how much strokes begin earlier, µm.
        run_out_um: By how much they end later, µm.
        on_us: From the start of the extended stroke to the first pulse, µs.
        off_us: From the end of the extended stroke to the last pulse, µs.
        cost: What the lines cost with them.
        formula_cost: What they cost with the offsets and delays of the formulas.
    """

    run_in_um: float
    run_out_um: float
    on_us: float
    off_us: float
    cost: float
    formula_cost: float

    @property
    def offsets(self) -> tuple[float, float, float, float]:
        """The four as :func:`postprocess` takes them."""
        return (self.run_in_um, self.run_out_um, self.on_us, self.off_us)


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
            or more, measured from crater centre to crater centre.

    Raises:
        GalvoError: The file cannot be read, or does not determine the regressions.
    """
    text = Path(lines).read_text(encoding="utf-8", errors="replace")
    toml, rows = _native.galvo_calibrate(text)
    lag, acceleration = (Regression(*row) for row in rows)
    return Calibration(lag, acceleration, toml)


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
) -> tuple[float, float]:
    """Machines a line on a simulated head without compensation, and measures it.

    Args:
        head: Name of a shipped head or of a TOML file.
        speed_m_s: Speed, m/s.
        length_um: Length as drawn, µm.
        angle_deg: Direction, degrees from x towards y.
        tolerance: The acceleration length ends where the speed stays within this part.

    Returns:
        Length from the first to the last crater's centre, and acceleration length, µm.

    Raises:
        OptionError, GalvoError: An option is outside its range.
    """
    text = head_text(head)
    return _native.galvo_measure_line(
        text, speed_m_s, length_um, math.radians(angle_deg), tolerance
    )


def compensation(
    head: str | Path = "bessel",
    *,
    speed_m_s: float,
    beam_um: float = 40.0,
    tolerance: float = 0.02,
    method: Method = "adaptive",
) -> Compensation:
    """Offsets and delays of strokes at a speed.

    Args:
        head: Name of a shipped head or of a TOML file. Its ``[calibration]`` is used where there is
            one, otherwise the model of its axes.
        speed_m_s: Speed, m/s.
        beam_um: Crater diameter by which strokes are shortened, µm.
        tolerance: Part by which pulses may be nearer or farther apart (models only).
        method: Which compensation.

    Raises:
        OptionError, GalvoError: An option is outside its range.
    """
    found = _native.galvo_compensation(head_text(head), method, speed_m_s, beam_um, tolerance)
    return Compensation(*found)


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


def tune(
    head: str | Path = "bessel",
    *,
    speed_m_s: float,
    start: Compensation | None = None,
    length_um: float = 2000.0,
    beam_um: float = 40.0,
    pitch_um: float = 40.0,
    delays_only: bool = False,
    edge_scale_um: float = 10.0,
    pitch_scale: float = 0.05,
    time_scale_us: float = 2000.0,
    evaluations: int = 1500,
    seed: int = 0,
) -> Tuning:
    """Finds offsets and delays for lines at one speed by CMA-ES on a simulated head.

    The cost is (|start error| + |end error|)/``edge_scale_um`` + largest
    |pitch - 1|/``pitch_scale`` + time beyond that of the drawn line/``time_scale_us``. The start is
    one of the candidates, so that the result is never worse.

    Args:
        head: Name of a shipped head or of a TOML file; its axes are simulated.
        speed_m_s: Speed, m/s.
        start: Where to start; by default the formulas for the head.
        length_um: Length of the line, µm.
        beam_um: Crater diameter, µm.
        pitch_um: Distance of pulses, µm.
        delays_only: Keep run-in and run-out at 0, for those who cannot postprocess.
        edge_scale_um: Edge error that costs 1, µm.
        pitch_scale: Deviation of the pitch that costs 1.
        time_scale_us: Time that costs 1, µs.
        evaluations: Lines that are simulated at most.
        seed: Seed of the search.

    Raises:
        OptionError, GalvoError: An option is outside its range.
    """
    text = head_text(head)
    if start is None:
        method: Method = "delays" if delays_only else "adaptive"
        start = compensation(head, speed_m_s=speed_m_s, beam_um=beam_um, method=method)
    line = [speed_m_s, length_um, 0.0, beam_um, pitch_um]
    scales = [edge_scale_um, pitch_scale, time_scale_us]
    first = np.array([start.run_in_um, start.run_out_um, start.on_us, start.off_us])
    # Lengths and times of the size of the lag, so that one step size fits all.
    size = max(start.lag_us, 1.0) * np.array([speed_m_s, speed_m_s, 1.0, 1.0])
    free = np.array([False, False, True, True]) if delays_only else np.ones(4, np.bool_)

    def costs(candidates: NDArray[np.float64]) -> NDArray[np.float64]:
        rows = np.tile(first, (len(candidates), 1))
        rows[:, free] = candidates * size[free]
        return np.array(_native.galvo_line_costs(text, line, scales, rows.tolist()))

    formula_cost = float(costs((first[free] / size[free])[None])[0])
    search = CmaEs(first[free] / size[free], 0.1, seed=seed, max_evaluations=evaluations)
    while search.termination is None:
        search.tell(costs(search.ask()))
    best, best_cost = first.copy(), formula_cost
    if search.best_cost < formula_cost:
        best[free], best_cost = search.best_x * size[free], search.best_cost
    run_in_um, run_out_um, on_us, off_us = best.tolist()
    return Tuning(run_in_um, run_out_um, on_us, off_us, best_cost, formula_cost)
