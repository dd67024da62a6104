"""Native half of the package: borrow, call, convert; documented where Python calls it."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Batch",
    "CmaEs",
    "Environment",
    "GalvoLineSet",
    "GalvoLines",
    "MillingBatch",
    "MillingEnvironment",
    "MillingJob",
    "Policy",
    "RemoteBatch",
    "RemoteEnvironment",
    "RemoteJob",
    "Rig",
    "Teacher",
    "TrajectoryPicture",
    "best_robot_line",
    "calibrate",
    "calibrate_simulator",
    "calibrate_trenches",
    "depths_of_heights",
    "disturbed_job",
    "galvo_calibrate",
    "galvo_compensation",
    "galvo_head",
    "galvo_heads",
    "galvo_identify",
    "galvo_measure_line",
    "galvo_postprocess",
    "galvo_simulate",
    "galvo_test_pattern",
    "gif",
    "load_drawing",
    "plan",
    "random_relief",
    "random_shape",
    "random_shape_areas",
    "read_csv",
    "read_gcode",
    "read_heights",
    "run_machine",
    "score",
    "shipped_policy",
    "shipped_profiles",
    "shortest_order",
    "simulator_options",
    "star",
    "target_png",
    "travel",
    "write_csv",
    "write_gcode",
]

@final
class Environment:
    def __new__(cls, settings: dict[str, Any]) -> Environment: ...
    def reset(self, seed: int | None = None) -> None: ...
    def reset_to(self, target: NDArray[np.bool_]) -> None: ...
    def step(self, x: float, y: float) -> tuple[float, bool, float, float, float]: ...
    def observation(self) -> NDArray[np.uint8]: ...
    def progress(self) -> tuple[float, float, int]: ...
    def is_success(self) -> bool: ...
    def layers(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]: ...
    def copy(self) -> Environment: ...

@final
class Policy:
    @staticmethod
    def from_bytes(content: bytes) -> Policy: ...
    def manifest(self) -> str: ...
    def parameters(self) -> int: ...
    def run(self, inputs: NDArray[np.float32]) -> NDArray[np.float32]: ...
    def act(self, observation: NDArray[np.uint8], max_pulses: int) -> NDArray[np.float32]: ...

@final
class Rig:
    @staticmethod
    def create(path: Path, options: str, seed: int) -> Rig: ...
    @staticmethod
    def open(path: Path) -> Rig: ...
    def state(self) -> str: ...
    def true_marks(self) -> NDArray[np.float64]: ...
    def limits_um(self) -> tuple[tuple[float, float], tuple[float, float]]: ...
    def move_to(self, x_um: float, y_um: float) -> None: ...
    def position_um(self) -> tuple[float, float]: ...
    def home(self) -> None: ...
    def stop(self) -> None: ...
    def arm(self) -> None: ...
    def fire(self) -> None: ...
    def disarm(self) -> None: ...
    def set_exposure_s(self, exposure_s: float) -> None: ...
    def frame(self) -> NDArray[np.uint8]: ...

@final
class Teacher:
    def __new__(
        cls, task: str, jobs: int, seed: int, moves: int, pulses: tuple[int, int] | None
    ) -> Teacher: ...
    def observe(self) -> tuple[NDArray[np.float32], NDArray[np.int64]]: ...
    def planned(self) -> NDArray[np.int64]: ...
    def values(self, pixels: NDArray[np.int64]) -> NDArray[np.int32]: ...
    def fire(self, corrections: NDArray[np.float32]) -> NDArray[np.float64]: ...

@final
class Batch:
    def __new__(
        cls,
        settings: dict[str, Any],
        num_envs: int,
        autoreset_mode: str,
        max_episode_steps: int | None,
        threads: int,
    ) -> Batch: ...
    def reset(
        self,
        seeds: Sequence[int | None],
        mask: Sequence[bool] | None,
        observations: NDArray[np.uint8],
    ) -> None: ...
    def reset_to(
        self, index: int, target: NDArray[np.bool_], observations: NDArray[np.uint8]
    ) -> None: ...
    def step(
        self,
        actions: NDArray[np.float32],
        observations: NDArray[np.uint8],
        final_observations: NDArray[np.uint8] | None = None,
    ) -> None: ...
    def rewards(self) -> NDArray[np.float64]: ...
    def terminated(self) -> NDArray[np.bool_]: ...
    def truncated(self) -> NDArray[np.bool_]: ...
    def progress(
        self,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]: ...
    def final_progress(
        self,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]: ...
    def finished(
        self,
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.float64], NDArray[np.int64]]: ...
    def last_pulses(self) -> NDArray[np.float64]: ...
    def layers(self, index: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]: ...

@final
class CmaEs:
    def __new__(
        cls,
        mean: NDArray[np.float64],
        sigma: float,
        population_size: int | None,
        seed: int,
        bounds: tuple[list[float], list[float]] | None,
        max_evaluations: int | None,
    ) -> CmaEs: ...
    def ask(self) -> NDArray[np.float64]: ...
    def tell(self, costs: NDArray[np.float64]) -> None: ...
    def best(self) -> tuple[NDArray[np.float64], float] | None: ...
    def progress(self) -> tuple[int, int, float]: ...
    def mean(self) -> NDArray[np.float64]: ...
    def termination(self) -> tuple[str, str] | None: ...

@final
class MillingBatch:
    def __new__(
        cls,
        settings: dict[str, Any],
        num_envs: int,
        autoreset_mode: str,
        max_episode_steps: int | None,
        threads: int,
    ) -> MillingBatch: ...
    def reset(
        self,
        seeds: Sequence[int | None],
        mask: Sequence[bool] | None,
        observations: NDArray[np.uint8],
    ) -> None: ...
    def reset_to(
        self, index: int, target: NDArray[np.float64], observations: NDArray[np.uint8]
    ) -> None: ...
    def step(
        self,
        actions: NDArray[np.float32],
        observations: NDArray[np.uint8],
        final_observations: NDArray[np.uint8] | None = None,
    ) -> None: ...
    def rewards(self) -> NDArray[np.float64]: ...
    def terminated(self) -> NDArray[np.bool_]: ...
    def truncated(self) -> NDArray[np.bool_]: ...
    def progress(
        self,
    ) -> tuple[
        NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]
    ]: ...
    def final_progress(
        self,
    ) -> tuple[
        NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]
    ]: ...
    def finished(
        self,
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.float64], NDArray[np.int64]]: ...
    def surfaces(self, index: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...
    def full_scale_um(self) -> float: ...

@final
class MillingEnvironment:
    def __new__(cls, settings: dict[str, Any]) -> MillingEnvironment: ...
    def reset(self, seed: int | None = None) -> None: ...
    def reset_to(self, target: NDArray[np.float64]) -> None: ...
    def step(self, x: float, y: float, dwell: float) -> tuple[float, bool, float, float, float]: ...
    def observation(self) -> NDArray[np.uint8]: ...
    def progress(self) -> tuple[float, float, float, int]: ...
    def is_success(self) -> bool: ...
    def surfaces(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...
    def scales(self) -> tuple[float, float, float]: ...
    def plan(
        self, planner: str, progress: Callable[[float], bool | None] | None
    ) -> tuple[NDArray[np.float32], tuple[float, float, float, int], float, bool]: ...
    def copy(self) -> MillingEnvironment: ...

_RemoteStop: TypeAlias = tuple[int, str, int, float, float, float, float, float]
_RemoteLine: TypeAlias = tuple[
    int,
    float,
    float,
    tuple[float, float],
    tuple[float, float],
    list[tuple[float, float]],
    int,
    float,
    float,
]

@final
class RemoteJob:
    def __new__(
        cls,
        task: str,
        folder: str | Path | None,
        choice: str,
        directions: int,
        keep_order: bool,
    ) -> RemoteJob: ...
    def figures(self) -> tuple[str, float, float, float, float, float]: ...
    def planes(self) -> list[tuple[str, list[float], list[float]]]: ...
    def stops(self) -> list[_RemoteStop]: ...
    def path(self, stop: int) -> NDArray[np.float64]: ...
    def lines(self) -> list[_RemoteLine]: ...
    def simulate(
        self, sample_s: float
    ) -> tuple[tuple[float, float, float, float, float, float], list[str], NDArray[np.float64]]: ...
    def programs(self) -> tuple[str, str, str, str, str]: ...

_RemoteProgress: TypeAlias = tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]

@final
class RemoteEnvironment:
    def __new__(cls, settings: dict[str, Any]) -> RemoteEnvironment: ...
    def reset(self, seed: int | None = None) -> None: ...
    def step(self, subtask: int, direction: int) -> tuple[float, bool]: ...
    def observation(self) -> NDArray[np.float32]: ...
    def progress(self) -> tuple[int, int, float]: ...
    def is_success(self) -> bool: ...
    def picture(
        self,
    ) -> tuple[
        float,
        list[tuple[float, float, float]],
        list[bool],
        list[tuple[tuple[float, float], tuple[float, float]]],
    ]: ...
    def planned(self) -> tuple[float, float, list[tuple[int, int]]]: ...
    def copy(self) -> RemoteEnvironment: ...

@final
class RemoteBatch:
    def __new__(
        cls,
        settings: dict[str, Any],
        num_envs: int,
        autoreset_mode: str,
        max_episode_steps: int | None,
    ) -> RemoteBatch: ...
    def reset(
        self,
        seeds: Sequence[int | None],
        mask: Sequence[bool] | None,
        observations: NDArray[np.float32],
    ) -> None: ...
    def step(
        self,
        actions: NDArray[np.int64],
        observations: NDArray[np.float32],
        final_observations: NDArray[np.float32] | None = None,
    ) -> None: ...
    def outcome(
        self,
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]]: ...
    def progress(self) -> _RemoteProgress: ...
    def final_progress(self) -> _RemoteProgress: ...
    def finished(
        self,
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.float64], NDArray[np.int64]]: ...

def best_robot_line(
    circles: NDArray[np.float64],
    direction_deg: float | None,
    speeds_mm_s: tuple[float, float],
    jump_s: float,
) -> tuple[tuple[float, float, float, float, float], list[tuple[float, float]]] | None: ...

_Controls: TypeAlias = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]

@final
class MillingJob:
    def __new__(
        cls,
        depth_um: NDArray[np.float64],
        pixel_um: float,
        profile: str,
        layers: int | None,
        measured_um: NDArray[np.float64] | None,
    ) -> MillingJob: ...
    def layout(self) -> tuple[int, float, float, float, int]: ...
    def speeds_mm_s(self) -> tuple[float, float]: ...
    def target_um(self) -> NDArray[np.float64]: ...
    def pixel_by_pixel(self) -> _Controls: ...
    def simulate(
        self, passes: dict[str, Any]
    ) -> tuple[NDArray[np.float64], tuple[float, float, float]]: ...
    def solve(
        self,
        settings: dict[str, Any],
        progress: Callable[[float, float], bool | None] | None,
    ) -> tuple[
        _Controls,
        NDArray[np.float64],
        tuple[float, float, float],
        float,
        float,
        list[tuple[bool, float, float]],
        bool,
    ]: ...
    def gradient(
        self, passes: dict[str, Any]
    ) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]: ...
    @staticmethod
    def times_s(passes: dict[str, Any]) -> tuple[float, float]: ...
    def programs(
        self,
        passes: dict[str, Any],
        power_s: float,
        origin_mm: tuple[float, float],
    ) -> tuple[str, str]: ...

@final
class TrajectoryPicture:
    def __new__(
        cls,
        target: NDArray[np.bool_],
        pulses: NDArray[np.float64],
        width_px: int,
        legend: bool,
        order_numbers: bool,
        caption: str | None,
    ) -> TrajectoryPicture: ...
    def svg(self) -> str: ...
    def png(self) -> bytes: ...
    def rgb_array(self) -> NDArray[np.uint8]: ...

def calibrate(
    drivers: tuple[Any, Any, Any],
    rough_scale_frame_px_per_um: float,
    pulse_radius_px: float,
    side_pulses: int,
    margin_um: float,
    max_residual_um: float,
) -> str: ...
def calibrate_simulator(options: str, seed: int) -> str: ...
def disturbed_job(
    target: NDArray[np.bool_],
    pulse_radius_px: float,
    max_pulses: int,
    decider: dict[str, Any],
    disturbance: dict[str, Any],
    seed: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64], tuple[float, float, float, int]]: ...
def gif(pictures: NDArray[np.uint8], delay_s: float) -> bytes: ...
def calibrate_trenches(
    trenches: str, profile: str
) -> tuple[list[tuple[str, float, float]], float]: ...
def depths_of_heights(
    heights: NDArray[np.float64], scale: str, depth_um: float, base_um: float
) -> NDArray[np.float64]: ...
def load_drawing(
    path: Path, margin_px: float, threshold: float, ink: str, invert: bool, fit: str
) -> NDArray[np.bool_]: ...
def plan(
    remaining: NDArray[np.bool_],
    forbidden: NDArray[np.bool_] | None,
    settings: dict[str, Any],
    progress: Callable[[float, float], bool | None] | None,
) -> tuple[NDArray[np.float64], float, float, float, bool]: ...
def random_relief(seed: int, depth_um: float) -> NDArray[np.float64]: ...
def random_shape(seed: int) -> NDArray[np.bool_]: ...
def random_shape_areas(first_seed: int, count: int) -> NDArray[np.int64]: ...
def read_csv(text: str, pulse_radius_px: float) -> NDArray[np.float64]: ...
def read_gcode(text: str, pulse_radius_px: float, frame: dict[str, Any]) -> NDArray[np.float64]: ...
def run_machine(
    settings: dict[str, Any],
    rig: Rig | None,
    drivers: tuple[Any, Any, Any] | None,
    progress: Callable[[dict[str, Any]], bool | None] | None,
) -> str: ...
def shipped_policy(name: str) -> bytes: ...
def read_heights(name: str, content: bytes, pixel_um: float) -> NDArray[np.float64]: ...
def score(
    target: NDArray[np.bool_], xy_px: NDArray[np.float64], pulse_radius_px: float
) -> tuple[float, float, float, int]: ...
def shipped_profiles() -> list[tuple[str, str]]: ...
def shortest_order(
    xy_px: NDArray[np.float64], start_px: tuple[float, float] | None
) -> NDArray[np.int64]: ...
def simulator_options(preset: str) -> str: ...
def star(angle_deg: float) -> NDArray[np.bool_]: ...
def target_png(target: NDArray[np.bool_]) -> bytes: ...
def travel(
    xy_px: NDArray[np.float64],
    max_speed_um_s: float,
    acceleration_um_s2: float,
    settling_s: float,
    pulse_s: float,
) -> tuple[float, float, float, float, float]: ...
def write_csv(xy_px: NDArray[np.float64], pulse_radius_px: float) -> str: ...
def write_gcode(
    xy_px: NDArray[np.float64],
    pulse_radius_px: float,
    frame: dict[str, Any],
    power_s: float,
    dwell_s: float,
    settling_s: float,
    feed_mm_min: float | None,
) -> str: ...

_PostSettings: TypeAlias = dict[str, Any]

def galvo_heads() -> list[tuple[str, str]]: ...
def galvo_head(head: str) -> tuple[float, float, bool]: ...
def galvo_postprocess(
    head: str, job: str, program: str, settings: _PostSettings, dialect: str, power: float
) -> int: ...
def galvo_simulate(
    head: str, program: str, map_px: int | None
) -> tuple[
    list[tuple[str, float]],
    NDArray[np.float64],
    tuple[float, float, float, float] | None,
    tuple[NDArray[np.float32], bytes] | None,
]: ...

_RegressionRow: TypeAlias = tuple[list[float], list[tuple[float, float, float | None]]]

def galvo_calibrate(
    lines: str,
) -> tuple[str, list[tuple[_RegressionRow, _RegressionRow, _RegressionRow | None]]]: ...
def galvo_identify(
    trajectory: str, family: str
) -> tuple[str, str, list[tuple[str, float, float]], float]: ...
def galvo_test_pattern(
    speeds_m_s: Sequence[float], length_um: float, repeats: int, spacing_um: float
) -> str: ...
def galvo_measure_line(
    head: str, speed_m_s: float, length_um: float, angle_rad: float, tolerance: float
) -> tuple[float, float, float]: ...
def galvo_compensation(
    head: str,
    method: str,
    line: tuple[float, float, float | None],
    beam_um: float,
    tolerance: float,
) -> list[float]: ...

@final
class GalvoLineSet:
    def __new__(
        cls,
        head: str,
        known: str,
        method: str,
        kind: Sequence[float],
        scales: Sequence[float],
        lines: Sequence[tuple[float, float]],
    ) -> GalvoLineSet: ...
    def costs(self, rows: Sequence[Sequence[float]]) -> list[float]: ...
    def outcomes(self, correction: Sequence[float]) -> list[list[float]]: ...

@final
class GalvoLines:
    def __new__(
        cls,
        environments: int,
        noise_um: float,
        edge_scale_um: float,
        pitch_scale: float,
        time_scale_us: float,
    ) -> GalvoLines: ...
    def reset(self, seeds: Sequence[int | None], mask: Sequence[bool] | None) -> None: ...
    def observations(self) -> NDArray[np.float32]: ...
    def baselines(self) -> NDArray[np.float32]: ...
    def step(self, actions: NDArray[np.float32]) -> list[NDArray[np.float64]]: ...
