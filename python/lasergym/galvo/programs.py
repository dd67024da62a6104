"""Programs of scan heads: the adaptive postprocessor, and what a program makes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from lasergym import _native
from lasergym.galvo.heads import head_text
from lasergym.options import integer_in

__all__ = [
    "DIALECTS",
    "Compensation",
    "Judgement",
    "Method",
    "compensation",
    "postprocess",
    "simulate",
]


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
