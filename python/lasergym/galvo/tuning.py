"""What CMA-ES adds to the formulas on a simulated scan head."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lasergym import _native
from lasergym.cma_es import CmaEs
from lasergym.errors import OptionError
from lasergym.galvo.heads import head_text
from lasergym.galvo.programs import Method, compensation

__all__ = [
    "LineOutcomes",
    "Tuning",
    "machine_lines",
    "tune",
]


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
