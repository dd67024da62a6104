"""Passes of a beam that mill a depth map: found, simulated, and corrected layer by layer."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lasergym import _native
from lasergym.milling.processes import profile_text
from lasergym.milling.surfaces import Surface, depth_array, measured_depths
from lasergym.options import integer_in

__all__ = [
    "ClosedLoop",
    "MillingResult",
    "Passes",
    "Plant",
    "ProgressCallback",
    "Simulation",
    "closed_loop",
    "simulate",
    "solve",
]


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

    def __getitem__(self, passes: slice) -> Passes:
        """Some of the passes; from an even one on they keep their directions."""
        return replace(
            self,
            y_um=self.y_um[passes],
            dwell_s_mm=self.dwell_s_mm[passes],
            beam_on=self.beam_on[passes],
        )

    def as_native(self) -> dict[str, Any]:
        """The passes as native code takes them."""
        return {
            "first_x_um": self.first_x_um,
            "spacing_um": self.spacing_um,
            "y_um": np.ascontiguousarray(self.y_um, dtype=np.float64),
            "dwell_s_mm": np.ascontiguousarray(self.dwell_s_mm, dtype=np.float64),
            "beam_on": np.ascontiguousarray(self.beam_on, dtype=np.bool_),
        }


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

    def layer(self, index: int) -> Passes:
        """The passes of one layer, from 0.

        Raises:
            OptionError: There are not so many layers.
        """
        index = integer_in("layer", index, 0, self.layers - 1)
        count = len(self.passes.y_um) // self.layers
        return self.passes[index * count : (index + 1) * count]

    def to_csv(self, *, layer: int | None = None) -> str:
        """The passes as CSV with the columns ``pass,point,x_um,y_um,speed_mm_s,beam_on``.

        Args:
            layer: Only this layer, from 0.
        """
        return self._programs(layer)[0]

    def to_gcode(
        self,
        *,
        layer: int | None = None,
        power_s: float = 1000.0,
        origin_mm: tuple[float, float] = (0.0, 0.0),
    ) -> str:
        """The passes as a GRBL program with a feed rate for every stretch.

        Args:
            layer: Only this layer, from 0.
            power_s: Power as the spindle word S.
            origin_mm: Machine position of the lower left corner of the target, mm; machine y up.

        Raises:
            OptionError: An option is outside its range.
        """
        return self._programs(layer, power_s, origin_mm)[1]

    def _programs(
        self,
        layer: int | None,
        power_s: float = 1000.0,
        origin_mm: tuple[float, float] = (0.0, 0.0),
    ) -> tuple[str, str]:
        passes = self.passes if layer is None else self.layer(layer)
        return self._job.programs(passes.as_native(), power_s, origin_mm)

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


Plant: TypeAlias = Callable[[Passes, Surface], ArrayLike]
"""Mills passes into a surface and measures what is left; depths, µm."""


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """What milling layer by layer with measurements has led to.

    Attributes:
        plans: The plan of the rest of the job before each layer; its first layer was milled.
        surfaces_um: The surface as measured after each layer, µm.
    """

    plans: tuple[MillingResult, ...]
    surfaces_um: tuple[Surface, ...]

    @property
    def depth_um(self) -> Surface:
        """The surface after the last layer, µm."""
        return self.surfaces_um[-1]


def solve(
    target_um: ArrayLike,
    *,
    pixel_um: float,
    process: str | Path = "laser-graphite",
    layers: int | None = None,
    measured_um: ArrayLike | None = None,
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
        measured_um: The surface that the workpiece has already, depths in µm over the whole target
            (with pixels of its own, if need be); the layers count from there on. What lies above
            the ground counts as ground. Default: flat.
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
    job = _job(target_um, pixel_um, process, layers, measured_um)
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
    passes = Passes(first_x_um, spacing_um, *controls)
    machining_time_s, exposure_s = job.times_s(passes.as_native())
    return MillingResult(
        passes=passes,
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
    measured_um: ArrayLike | None = None,
) -> Simulation:
    """Mills along passes and compares the surface with a target.

    Args:
        passes: The passes, of this process or of a model that differs from it; None for the
            pixel-by-pixel passes of the target.
        target_um: Depth of each pixel, µm; shape (rows, columns).
        pixel_um: Side of a pixel, µm.
        process: Name of a shipped profile or of a TOML file.
        layers: Number of layers, for the pixel-by-pixel passes.
        measured_um: The surface before the passes, as for :func:`solve`.

    Raises:
        MillingError: The passes leave the simulated ground, or are not usable.
        DepthMapError, EmptyTargetError, OptionError: As for :func:`solve`.
    """
    job = _job(target_um, pixel_um, process, layers, measured_um)
    if passes is None:
        _, first_x_um, spacing_um, _, _ = job.layout()
        passes = Passes(first_x_um, spacing_um, *job.pixel_by_pixel())
    native = passes.as_native()
    depth_um, errors = job.simulate(native)
    return Simulation(depth_um, *errors, job.times_s(native)[0])


def closed_loop(
    target_um: ArrayLike,
    plant: Plant,
    *,
    layers: int,
    measured_um: ArrayLike | None = None,
    **settings: Any,
) -> ClosedLoop:
    """Mills layer by layer and plans anew from the measured surface before each.

    A model that is a little wrong then does little harm.

    Args:
        target_um: Depth of each pixel, µm; shape (rows, columns).
        plant: Mills the passes of a layer and measures what is left: called with the passes and the
            surface before them, it returns the surface after them, depths in µm over the whole
            target. :func:`simulate` with another process makes one.
        layers: Number of layers, from 1 to 100.
        measured_um: The surface before the first layer. Default: flat.
        settings: The other arguments of :func:`solve`.

    Returns:
        The surface after every layer, and the plan of every layer for the rest of the job.

    Raises:
        DepthMapError, EmptyTargetError, OptionError, MillingError: As for :func:`solve`.
    """
    target = depth_array(target_um)
    surface = np.zeros_like(target) if measured_um is None else depth_array(measured_um)
    plans, surfaces = [], []
    for left in range(integer_in("layers", layers, 1, 100), 0, -1):
        plan = solve(target, layers=left, measured_um=surface, **settings)
        surface = depth_array(plant(plan.layer(0), surface))
        plans.append(plan)
        surfaces.append(surface)
        if plan.partial:
            break
    return ClosedLoop(tuple(plans), tuple(surfaces))


def _job(
    target_um: ArrayLike,
    pixel_um: float,
    process: str | Path,
    layers: int | None,
    measured_um: ArrayLike | None,
) -> _native.MillingJob:
    return _native.MillingJob(
        depth_array(target_um),
        pixel_um,
        profile_text(process),
        None if layers is None else integer_in("layers", layers, 1, 100),
        None if measured_um is None else measured_depths(measured_um),
    )
