"""Depth milling with a laser or a waterjet: given a surface, find the passes of the beam.

Source: Bilbao-Guillerna, Axinte, Billingham and Cadot, "Waterjet and laser etching: the nonlinear
inverse problem", Royal Society Open Science 4 (2017).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lasergym import _native
from lasergym.errors import DepthMapError, OptionError
from lasergym.options import integer_in

__all__ = [
    "PROCESSES",
    "Calibration",
    "FittedParameter",
    "MillingResult",
    "Passes",
    "ProgressCallback",
    "Simulation",
    "calibrate",
    "depths",
    "load_heights",
    "simulate",
    "solve",
]

_SHIPPED: dict[str, str] = dict(_native.shipped_profiles())

PROCESSES: tuple[str, ...] = tuple(_SHIPPED)
"""Names of the shipped process profiles."""

Surface: TypeAlias = NDArray[np.float64]

HeightScale: TypeAlias = Literal["depths", "high-stays", "high-sinks"]
"""What the values of a height map mean; see :func:`depths`."""

ProgressCallback: TypeAlias = Callable[[float, float], "bool | None"]
"""Called with (fraction done in [0, 1], tracking error in %); returning True stops the solver."""


@dataclass(frozen=True, eq=False)
class Passes:
    """Passes of a beam, layer by layer; every second one runs from right to left.

    Attributes:
        first_x_um: x of the first point of every pass, µm.
        spacing_um: Distance between points along x, µm.
        y_um: y of each point, µm; shape (passes, points), y down.
        dwell_s_mm: Time per length at each point, s/mm; shape (passes, points).
        beam_on: Whether the beam is on between neighbouring points; shape (passes, points - 1).
    """

    first_x_um: float
    spacing_um: float
    y_um: NDArray[np.float64]
    dwell_s_mm: NDArray[np.float64]
    beam_on: NDArray[np.bool_]

    @property
    def x_um(self) -> NDArray[np.float64]:
        """Where the points of every pass lie along x, µm; shape (points,)."""
        return self.first_x_um + self.spacing_um * np.arange(self.y_um.shape[1], dtype=np.float64)

    @property
    def speed_mm_s(self) -> NDArray[np.float64]:
        """Feed speed at each point, mm/s; shape (passes, points)."""
        return 1 / self.dwell_s_mm

    def _native(self) -> tuple[Any, Any, Any]:
        return (
            np.ascontiguousarray(self.y_um, dtype=np.float64),
            np.ascontiguousarray(self.dwell_s_mm, dtype=np.float64),
            np.ascontiguousarray(self.beam_on, dtype=np.bool_),
        )


@dataclass(frozen=True, eq=False)
class Simulation:
    """The surface that passes leave.

    Attributes:
        depth_um: Depth of each pixel, µm; shape (rows, columns) of the simulation's pixels.
        tracking_error_percent: 100 Σ|depth - target| / Σ target, %.
        max_error_um: Largest distance from the target, µm.
        rms_error_um: Root mean square distance from the target, µm.
        machining_time_s: Time of all passes, s, without the ways between them.
    """

    depth_um: Surface
    tracking_error_percent: float
    max_error_um: float
    rms_error_um: float
    machining_time_s: float


@dataclass(frozen=True, eq=False)
class MillingResult:
    """Passes that mill a target, and how well.

    Attributes:
        passes: The passes.
        target_um: The target with the pixels of the simulation, µm; shape (rows, columns).
        depth_um: The surface that the passes are predicted to leave, µm; same shape.
        pixel_um: Side of those pixels, µm.
        layers: Number of layers.
        tracking_error_percent: 100 Σ|depth - target| / Σ target, %.
        max_error_um: Largest distance from the target, µm.
        rms_error_um: Root mean square distance from the target, µm.
        pixel_by_pixel_error_percent: Tracking error of the pixel-by-pixel passes, %.
        straight_error_percent: Tracking error after the straight passes alone, %.
        convergence_percent: Tracking error after each iteration, %, the start first.
        machining_time_s: Time of all passes, s, without the ways between them.
        exposure_s: Part of it with the beam on, s.
        elapsed_s: Time that solving took, s.
        partial: Whether the solver was stopped (by Ctrl-C or the callback) before it had finished.
    """

    passes: Passes
    target_um: Surface
    depth_um: Surface
    pixel_um: float
    layers: int
    tracking_error_percent: float
    max_error_um: float
    rms_error_um: float
    pixel_by_pixel_error_percent: float
    straight_error_percent: float
    convergence_percent: NDArray[np.float64]
    machining_time_s: float
    exposure_s: float
    elapsed_s: float
    partial: bool
    _job: _native.MillingJob

    def to_csv(self) -> str:
        """The passes as CSV with the columns ``pass,point,x_um,y_um,speed_mm_s,beam_on``."""
        return self._programs()[0]

    def to_gcode(
        self, *, power_s: float = 1000.0, origin_mm: tuple[float, float] = (0.0, 0.0)
    ) -> str:
        """The passes as a GRBL program with a feed rate for every stretch.

        Args:
            power_s: Power as the spindle word S.
            origin_mm: Machine position of the lower left corner of the target, mm; machine y up.

        Raises:
            OptionError: An option is outside its range.
        """
        return self._programs(power_s, origin_mm)[1]

    def _programs(
        self, power_s: float = 1000.0, origin_mm: tuple[float, float] = (0.0, 0.0)
    ) -> tuple[str, str]:
        return self._job.programs(*self.passes._native(), power_s, origin_mm)

    def as_dict(self) -> dict[str, Any]:
        """The figures as a JSON report holds them."""
        return {
            "layers": self.layers,
            "passes": len(self.passes.y_um),
            "rows": self.target_um.shape[0],
            "columns": self.target_um.shape[1],
            "pixel_um": self.pixel_um,
            "tracking_error_percent": self.tracking_error_percent,
            "max_error_um": self.max_error_um,
            "rms_error_um": self.rms_error_um,
            "pixel_by_pixel_error_percent": self.pixel_by_pixel_error_percent,
            "straight_error_percent": self.straight_error_percent,
            "machining_time_s": self.machining_time_s,
            "exposure_s": self.exposure_s,
            "elapsed_s": self.elapsed_s,
            "iterations": len(self.convergence_percent) - 1,
            "partial": self.partial,
        }


@dataclass(frozen=True)
class FittedParameter:
    """A parameter and how well trenches determine it.

    Attributes:
        name: Its name, unit included, as in profiles.
        value: The value that fits best.
        confidence_95: Half-width of its 95 % confidence interval.
    """

    name: str
    value: float
    confidence_95: float


@dataclass(frozen=True)
class Calibration:
    """A process fitted to trenches.

    Attributes:
        parameters: The fitted parameters.
        rms_um: Root mean square distance between measured and modelled depths, µm.
    """

    parameters: tuple[FittedParameter, ...]
    rms_um: float


def solve(
    target_um: ArrayLike,
    *,
    pixel_um: float,
    process: str | Path = "laser-graphite",
    layers: int | None = None,
    iterations: int = 45,
    switching_rounds: int = 2,
    free_iterations: int = 30,
    free_range: float = 0.5,
    least_fall: float = 1e-3,
    progress: ProgressCallback | None = None,
) -> MillingResult:
    """Finds the passes that mill a depth map.

    Args:
        target_um: Depth of each pixel, µm, at least 0; shape (rows, columns), x right, y down.
        pixel_um: Side of a pixel, µm. Pixels too coarse for the beam are divided.
        process: Name of a shipped profile (see :data:`PROCESSES`) or of a TOML file.
        layers: Number of layers, from 1 to 100; by default as few as reach the deepest pixel with a
            reserve of a quarter.
        iterations: Most iterations on the dwell of straight passes.
        switching_rounds: Rounds of switching the beam on or off where that helps.
        free_iterations: Most iterations in which passes may leave their lines; 0: straight.
        free_range: How far they may, as a part of the pitch, in (0, 0.5].
        least_fall: Stop when five iterations in a row lower the objective by less than this part.
        progress: Called after each iteration; returning True stops the solver.

    Returns:
        The passes and what they are predicted to leave. After Ctrl-C, or when ``progress`` stops
        the solver, the best so far, with ``partial`` set.

    Raises:
        DepthMapError: The target has a value that is no depth or out of the machine's reach; the
            message names the place.
        EmptyTargetError: There is nothing to remove.
        OptionError: An option is outside its range.
        MillingError: The profile cannot be read, or the job is too large.
    """
    started_s = time.perf_counter()
    job = _native.MillingJob(
        _depth_array(target_um),
        pixel_um,
        profile_text(process),
        None if layers is None else integer_in("layers", layers, 1, 100),
    )
    settings = {
        "iterations": integer_in("iterations", iterations, 1, 10_000),
        "switching_rounds": integer_in("switching_rounds", switching_rounds, 0, 100),
        "free_iterations": integer_in("free_iterations", free_iterations, 0, 10_000),
        "free_range": free_range,
        "least_fall": least_fall,
    }
    controls, depth_um, errors, pixel, straight, convergence, partial = job.solve(
        settings, progress
    )
    count, first_x_um, spacing_um, cell_um, _ = job.layout()
    machining_time_s, exposure_s = job.times_s(*controls)
    return MillingResult(
        passes=Passes(first_x_um, spacing_um, *controls),
        target_um=job.target_um(),
        depth_um=depth_um,
        pixel_um=cell_um,
        layers=count,
        tracking_error_percent=errors[0],
        max_error_um=errors[1],
        rms_error_um=errors[2],
        pixel_by_pixel_error_percent=pixel,
        straight_error_percent=straight,
        convergence_percent=np.array([error for _, _, error in convergence]),
        machining_time_s=machining_time_s,
        exposure_s=exposure_s,
        elapsed_s=time.perf_counter() - started_s,
        partial=partial,
        _job=job,
    )


def simulate(
    passes: Passes | None,
    target_um: ArrayLike,
    *,
    pixel_um: float,
    process: str | Path = "laser-graphite",
    layers: int | None = None,
) -> Simulation:
    """Mills flat ground along passes and compares it with a target.

    Args:
        passes: The passes, with the first x and spacing that :func:`solve` gives them; None for the
            pixel-by-pixel passes of the target.
        target_um: Depth of each pixel, µm; shape (rows, columns).
        pixel_um: Side of a pixel, µm.
        process: Name of a shipped profile or of a TOML file.
        layers: Number of layers, for the pixel-by-pixel passes.

    Raises:
        MillingError: The passes leave the simulated ground, or are not usable.
        DepthMapError, EmptyTargetError, OptionError: As for :func:`solve`.
    """
    job = _native.MillingJob(_depth_array(target_um), pixel_um, profile_text(process), layers)
    controls = job.pixel_by_pixel() if passes is None else passes._native()
    depth_um, errors = job.simulate(*controls)
    return Simulation(depth_um, *errors, job.times_s(*controls)[0])


def calibrate(trenches: str | Path, process: str | Path = "laser-graphite") -> Calibration:
    """Fits footprint and law of a process to measured trenches of straight passes.

    Args:
        trenches: Name of a CSV file with the columns ``speed_mm_s,y_um,depth_um``; lines of equal
            speed that follow one another are one trench. Two speeds or more.
        process: The profile to start from.

    Raises:
        MillingError: The file cannot be read, or does not determine the parameters.
    """
    text = Path(trenches).read_text(encoding="utf-8", errors="replace")
    parameters, rms_um = _native.calibrate_trenches(text, profile_text(process))
    return Calibration(tuple(FittedParameter(*parameter) for parameter in parameters), rms_um)


def load_heights(path: str | Path, *, pixel_um: float = 1.0) -> Surface:
    """Reads the heights in an NPY, ASC (DEM), PNG or STL file; shape (rows, columns).

    Args:
        path: The file; brighter pixels of a PNG are higher, of an STL the top surface counts.
        pixel_um: Side of a pixel, µm, for STL; its heights are µm above its lowest point.

    Raises:
        DepthMapError: The file is damaged or of no known kind.
    """
    path = Path(path)
    return _native.read_heights(path.name, path.read_bytes(), pixel_um)


def depths(
    heights: ArrayLike,
    *,
    depth_um: float = 1.0,
    base_um: float = 0.0,
    scale: HeightScale = "high-stays",
) -> Surface:
    """Depths of heights, µm.

    Args:
        heights: Any numbers, shape (rows, columns).
        depth_um: Difference in depth between the highest and the lowest, µm.
        base_um: Depth of the shallowest pixel, µm.
        scale: ``"high-stays"``: the highest pixel is the shallowest, as in a relief that stands up;
            ``"high-sinks"``: it is the deepest; ``"depths"``: the values are depths already, µm.

    Raises:
        DepthMapError, EmptyTargetError, OptionError: The heights or options cannot be used.
    """
    return _native.depths_of_heights(_depth_array(heights), scale, depth_um, base_um)


def profile_text(process: str | Path) -> str:
    """The TOML text of a shipped profile or of a file.

    Raises:
        OptionError: There is neither a profile nor a file of that name.
    """
    if isinstance(process, str) and process in _SHIPPED:
        return _SHIPPED[process]
    path = Path(process)
    if not path.is_file():
        names = ", ".join(PROCESSES)
        raise OptionError(f"process is {str(process)!r}, but must be {names} or a TOML file")
    return path.read_text(encoding="utf-8", errors="replace")


def _depth_array(values: ArrayLike) -> Surface:
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise DepthMapError(f"the depth map has values that are not numbers: {error}") from error
    if array.ndim != 2:
        raise DepthMapError(
            f"the depth map has shape {array.shape}, but must have shape (rows, columns)"
        )
    return np.ascontiguousarray(array)
