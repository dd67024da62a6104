"""Depth milling with a laser or a waterjet: given a surface, find the passes of the beam.

Source: Bilbao-Guillerna, Axinte, Billingham and Cadot, "Waterjet and laser etching: the nonlinear
inverse problem", Royal Society Open Science 4 (2017).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lasergym import _native
from lasergym.errors import DepthMapError, OptionError
from lasergym.options import LARGEST_SEED, integer_in

__all__ = [
    "PROCESSES",
    "SPOT_PLANNERS",
    "Calibration",
    "ClosedLoop",
    "FittedParameter",
    "MillingResult",
    "Passes",
    "Plant",
    "ProgressCallback",
    "Simulation",
    "SpotPlan",
    "SpotPlannerName",
    "calibrate",
    "closed_loop",
    "depths",
    "full_scale_um",
    "load_heights",
    "plan_spots",
    "random_relief",
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


SpotPlannerName: TypeAlias = Literal["pixel-by-pixel", "adjoint"]
"""Planners of the milling environment."""

SPOT_PLANNERS: tuple[SpotPlannerName, ...] = get_args(SpotPlannerName)
"""All of them, the fastest first."""


@dataclass(frozen=True, eq=False)
class SpotPlan:
    """Spots in the order in which they are milled, and what they achieve.

    Attributes:
        planner: Name of the planner.
        actions: The spots as actions of the environment, float32 of shape (spots, 3).
        side_um: Side of the workpiece, µm.
        longest_dwell_s: Dwell of an action of 1, s.
        reward: Sum of the rewards: 1 − the tracking error.
        tracking_error_percent: Tracking error after them, %.
        machined_fraction: Volume removed above the target over the volume of the target.
        off_target_fraction: Volume removed below the target over the volume of the target.
        elapsed_s: Time that planning took, s.
        partial: Whether the planner was stopped before it had finished.
    """

    planner: str
    actions: NDArray[np.float32]
    side_um: float
    longest_dwell_s: float
    reward: float
    tracking_error_percent: float
    machined_fraction: float
    off_target_fraction: float
    elapsed_s: float
    partial: bool

    @property
    def spots(self) -> int:
        """Number of spots."""
        return len(self.actions)

    @property
    def xy_um(self) -> NDArray[np.float64]:
        """Places of the spots, µm; shape (spots, 2)."""
        return 0.5 * (1 + self.actions[:, :2].astype(np.float64)) * self.side_um

    @property
    def dwell_s(self) -> NDArray[np.float64]:
        """Dwell of each spot, s; shape (spots,)."""
        return 0.5 * (1 + self.actions[:, 2].astype(np.float64)) * self.longest_dwell_s


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
    target = _depth_array(target_um)
    surface = np.zeros_like(target) if measured_um is None else _depth_array(measured_um)
    plans, surfaces = [], []
    for left in range(integer_in("layers", layers, 1, 100), 0, -1):
        plan = solve(target, layers=left, measured_um=surface, **settings)
        surface = _depth_array(plant(plan.layer(0), surface))
        plans.append(plan)
        surfaces.append(surface)
        if plan.partial:
            break
    return ClosedLoop(tuple(plans), tuple(surfaces))


def plan_spots(
    target_um: ArrayLike,
    planner: SpotPlannerName = "adjoint",
    *,
    progress: Callable[[float], bool | None] | None = None,
    **settings: Any,
) -> SpotPlan:
    """Plans all spots of an episode of ``lasergym/Milling-v0``.

    Args:
        target_um: Depth of each pixel, µm; shape (100, 100).
        planner: ``"pixel-by-pixel"`` (spots on a raster, each with the dwell of the depth there) or
            ``"adjoint"`` (dwell and y of the same spots optimised together).
        progress: Called with the fraction done; returning True stops the planner.
        settings: Arguments of the environment.

    Returns:
        The spots, and what the environment says of them.

    Raises:
        DepthMapError, EmptyTargetError, OptionError: The target or an argument cannot be used.
    """
    from lasergym.envs.milling_settings import MillingSettings

    started_s = time.perf_counter()
    native = _native.MillingEnvironment(MillingSettings(target=target_um, **settings).as_native())
    native.reset(0)
    actions, figures, episode_return, partial = native.plan(planner, progress)
    return SpotPlan(
        planner=planner,
        actions=actions,
        side_um=native.scales()[0],
        longest_dwell_s=native.scales()[2],
        reward=episode_return,
        tracking_error_percent=figures[0],
        machined_fraction=figures[1],
        off_target_fraction=figures[2],
        elapsed_s=time.perf_counter() - started_s,
        partial=partial,
    )


def full_scale_um(process: str | Path = "laser-graphite") -> float:
    """Depth of the deepest place of the milling environment's random reliefs, µm."""
    from lasergym.envs.milling_settings import MillingSettings

    return _native.MillingEnvironment(MillingSettings(process=process).as_native()).scales()[1]


def random_relief(seed: int = 0, *, depth_um: float = 22.5) -> Surface:
    """A smooth random target of the milling environment, depths from 0 to ``depth_um``.

    Args:
        seed: Names the relief, from 0 to 2⁶⁴ − 1. Seeds from 2 000 000 000 up are kept for
            evaluation.
        depth_um: Depth of the deepest place, µm, above 0 and at most 1e6.

    Returns:
        float64 of shape (100, 100), µm.

    Raises:
        OptionError: An argument is outside its range.
    """
    if not 0 < depth_um <= 1e6:
        raise OptionError(f"depth_um is {depth_um}, but must be above 0 and at most 1e6 µm")
    return _native.random_relief(integer_in("seed", seed, 0, LARGEST_SEED), float(depth_um))


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
    """Reads the heights in an NPY, ASC (DEM), PNG, TIFF or STL file; shape (rows, columns).

    Args:
        path: The file; brighter pixels of a picture are higher, of an STL the top surface counts.
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


def _job(
    target_um: ArrayLike,
    pixel_um: float,
    process: str | Path,
    layers: int | None,
    measured_um: ArrayLike | None,
) -> _native.MillingJob:
    return _native.MillingJob(
        _depth_array(target_um),
        pixel_um,
        profile_text(process),
        None if layers is None else integer_in("layers", layers, 1, 100),
        None if measured_um is None else _measured(measured_um),
    )


def _measured(values: ArrayLike) -> Surface:
    """A measured surface without what noise lifts above the ground."""
    array = _depth_array(values)
    if not np.isfinite(array).all():
        row, column = np.argwhere(~np.isfinite(array))[0].tolist()
        raise DepthMapError(
            f"the measured surface is {array[row, column]} at row {row}, column {column}: depths "
            "must be finite"
        )
    return np.maximum(array, 0.0)


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
