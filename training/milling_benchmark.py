"""Measurements of depth milling that need Python: against PyTorch, on terrain, on a large target.

    python training/milling_benchmark.py torch     # gradient beside PyTorch autograd (extra train)
    python training/milling_benchmark.py terrain   # the terrain that matplotlib ships
    python training/milling_benchmark.py large     # 500 × 500 pixels under 200 passes
    python training/milling_benchmark.py scaling   # time against path length × window

Times are of one thread; ``processor`` is processor time, which other work on the machine changes
little.
"""

from __future__ import annotations

import argparse
import math
import resource
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lasergym import _native, milling

REACH_UM = 400.0
PEAK_UM_S = 3000.0
FIRST_PER_RAD, SECOND_PER_RAD2, SMOOTHING = 0.5540, 0.1363, 0.01
SLOWEST_MM_S = 8.0
"""Of the shipped profile waterjet-garnet."""

LENGTHENING = 2.0
"""How much longer than straight ones the steps are laid out for."""


def timed(work: Callable[[], Any], rounds: int) -> tuple[float, float]:
    """Least (wall, processor) time of some rounds, s."""
    times = []
    for _ in range(rounds):
        wall, processor = time.perf_counter(), time.process_time()
        work()
        times.append((time.perf_counter() - wall, time.process_time() - processor))
    return min(wall for wall, _ in times), min(processor for _, processor in times)


def torch_gradient(
    torch: Any, passes: milling.Passes, target_um: NDArray[np.float64], pixel_um: float
) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """Objective and gradient of the waterjet model in PyTorch, vectorised over the window."""
    rows, columns = target_um.shape
    margin = math.ceil((2.5 * REACH_UM) / pixel_um) + 3
    depth = torch.zeros((rows + 2 * margin, columns + 2 * margin), dtype=torch.float64)
    y = torch.tensor(passes.y_um, requires_grad=True)
    dwell = torch.tensor(passes.dwell_s_mm, requires_grad=True)
    spacing_um = passes.spacing_um
    angles = np.linspace(0, math.pi / 2, 10_001)
    steepest = np.max((FIRST_PER_RAD + 2 * SECOND_PER_RAD2 * angles) * np.cos(angles) ** 2)
    longest_s = LENGTHENING * spacing_um * 1e-3 / SLOWEST_MM_S
    courant = longest_s * PEAK_UM_S * float(steepest) / pixel_um
    parts = math.ceil(max(spacing_um / (0.2 * REACH_UM), courant / 0.35) * (1 - 1e-9))
    side = math.floor(2 * REACH_UM / pixel_um) + 1
    flat_rad = math.atan(SMOOTHING)
    places = torch.arange(side, dtype=torch.float64)

    def corner(place_um: float) -> int:
        return math.ceil((place_um - REACH_UM) / pixel_um - 0.5) + margin

    for number in range(len(passes.y_um)):
        steps = [
            (point, part) for point in range(passes.y_um.shape[1] - 1) for part in range(parts)
        ]
        for point, part in steps[::-1] if number % 2 else steps:
            fraction = (part + 0.5) / parts
            here, after = y[number, point], y[number, point + 1]
            y_um = (1 - fraction) * here + fraction * after
            mean = (1 - fraction) * dwell[number, point] + fraction * dwell[number, point + 1]
            length_mm = torch.sqrt(spacing_um**2 + (after - here) ** 2) * 1e-3
            dose_s = length_mm / parts * mean
            x_um = passes.first_x_um + (point + fraction) * spacing_um
            top, left = corner(float(y_um.detach())), corner(x_um)
            across = (places + (top - margin + 0.5)) * pixel_um - y_um
            along = (places + (left - margin + 0.5)) * pixel_um - x_um
            rest = 1 - (across[:, None] ** 2 + along**2) / REACH_UM**2
            rate = PEAK_UM_S * torch.clamp(rest, min=0) ** 2
            around = depth[top - 1 : top + side + 1, left - 1 : left + side + 1]
            p = (around[1:-1, 2:] - around[1:-1, :-2]) / (2 * pixel_um)
            q = (around[2:, 1:-1] - around[:-2, 1:-1]) / (2 * pixel_um)
            angle = torch.atan(torch.sqrt(p * p + q * q + SMOOTHING**2)) - flat_rad
            factor = torch.clamp(1 - angle * (FIRST_PER_RAD + angle * SECOND_PER_RAD2), min=0)
            depth[top : top + side, left : left + side] += dose_s * rate * factor
    inside = depth[margin : margin + rows, margin : margin + columns]
    objective = 0.5 * pixel_um**2 * ((inside - torch.tensor(target_um)) ** 2).sum()
    objective.backward()
    return float(objective.detach()), dwell.grad.numpy(), y.grad.numpy()


def against_torch() -> None:
    """Times one gradient of the waterjet here and in PyTorch, on one thread each."""
    import torch

    torch.set_num_threads(1)
    process, pixel_um = "waterjet-garnet", 50.0
    print("controls  lasergym ms  torch ms  torch/lasergym  (processor time)  largest difference")
    for rows, columns in ((20, 20), (60, 40)):
        y, x = np.mgrid[0:rows, 0:columns]
        target_um = 100 + 20 * np.sin(0.2 * x) * np.cos(0.15 * y)
        job = _native.MillingJob(target_um, pixel_um, milling.profile_text(process), 1, None)
        _, first_x_um, spacing_um, _, _ = job.layout()
        passes = milling.Passes(first_x_um, spacing_um, *job.pixel_by_pixel())
        noise = np.random.default_rng(0).uniform(-20, 20, passes.y_um.shape)
        passes.y_um[:] += noise
        native = passes.as_native()
        _, ours_s = timed(partial(job.gradient, native), 7)
        _, theirs_s = timed(partial(torch_gradient, torch, passes, target_um, pixel_um), 3)
        objective, dwell, across = job.gradient(native)
        expected = torch_gradient(torch, passes, target_um, pixel_um)
        differences = [abs(objective / expected[0] - 1)]
        for found, other in ((dwell, expected[1]), (across, expected[2])):
            differences.append(np.abs(found - other).max() / np.abs(other).max())
        print(
            f"{2 * passes.y_um.size:>8} {1e3 * ours_s:>12.2f} {1e3 * theirs_s:>9.0f} "
            f"{theirs_s / ours_s:>15.0f} {max(differences):>39.1e}"
        )


def report(name: str, target_um: NDArray[np.float64], **settings: Any) -> None:
    """Solves and prints what it took."""
    wall, processor = time.perf_counter(), time.process_time()
    result = milling.solve(target_um, **settings)
    wall, processor = time.perf_counter() - wall, time.process_time() - processor
    memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(
        f"{name:<24} layers {result.layers}, passes {len(result.passes.y_um)}, controls "
        f"{2 * result.passes.y_um.size}: pixel by pixel "
        f"{result.pixel_by_pixel_error_percent:.2f} %, "
        f"straight {result.straight_error_percent:.3f} %, "
        f"free {result.tracking_error_percent:.3f} %; {wall:.1f} s, "
        f"processor {processor:.1f} s, {memory_mb:.0f} MB",
        flush=True,
    )


def terrain() -> None:
    """The elevation model that matplotlib ships, as deep as each process likes it."""
    from matplotlib import cbook

    with cbook.get_sample_data("jacksboro_fault_dem.npz") as data:
        heights = np.asarray(data["elevation"], dtype=np.float64)
    deep = milling.depths(heights, depth_um=160, base_um=60)
    report("terrain, waterjet", deep, pixel_um=50.0, process="waterjet-garnet")
    deep = milling.depths(heights, depth_um=50, base_um=8)
    report("terrain, laser", deep, pixel_um=5.0, process="laser-graphite")


def waves(size: int, base_um: float, depth_um: float) -> NDArray[np.float64]:
    """A wavy square target with a step."""
    y, x = np.mgrid[0:size, 0:size] / size
    wave = 0.35 + 0.25 * np.sin(9 * x) * np.cos(7 * y) + 0.4 * (np.hypot(x - 0.5, y - 0.5) < 0.2)
    return base_um + depth_um * wave


def large() -> None:
    """500 × 500 pixels under about 200 passes of one layer, with the solver's defaults."""
    report("500 × 500, laser", waves(500, 8, 5), pixel_um=5.9, process="laser-graphite", layers=1)
    settings: dict[str, Any] = {"pixel_um": 79.0, "process": "waterjet-garnet", "layers": 1}
    report("500 × 500, waterjet", waves(500, 60, 160), **settings)


def scaling() -> None:
    """Processor time of a gradient over path length × window: the last column is to stay."""
    print("process          pixels  steps × window  gradient ms  ns each")
    for process, pixel_um, base_um in (("laser-graphite", 5.0, 9), ("waterjet-garnet", 50.0, 90)):
        reach_um = {"laser-graphite": 45.0, "waterjet-garnet": 400.0}[process]
        for size in (50, 100, 200, 400):
            for pixel in (pixel_um, pixel_um / 2):
                target_um = waves(size, base_um, 0.3 * base_um)
                job = _native.MillingJob(target_um, pixel, milling.profile_text(process), 1, None)
                _, first_x_um, spacing_um, _, _ = job.layout()
                passes = milling.Passes(first_x_um, spacing_um, *job.pixel_by_pixel())
                native = passes.as_native()
                _, processor_s = timed(partial(job.gradient, native), 3)
                window = (math.floor(2 * reach_um / pixel) + 1) ** 2
                stretches = passes.beam_on.sum()
                print(
                    f"{process:<16} {size:>6} {stretches * window:>15} {1e3 * processor_s:>12.2f} "
                    f"{1e9 * processor_s / (stretches * window):>8.1f}"
                )


def main() -> None:
    """Runs the study that is asked for."""
    studies = {"torch": against_torch, "terrain": terrain, "large": large, "scaling": scaling}
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("study", choices=studies)
    studies[parser.parse_args().study]()


if __name__ == "__main__":
    main()
