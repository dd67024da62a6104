"""How long planning takes: the eight holes of the heat exchanger, and random sheets of holes.

``python tests/python/remote_planning_time.py`` prints processor time, reading the task included.
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from lasergym import remote

EXCHANGER = Path(__file__).parents[1] / "assets" / "heat_exchanger.toml"


def sheet(holes: int) -> str:
    """A task of holes, one on every 75 000 mm²."""
    generator = np.random.default_rng(0)
    side_mm = (75_000 * holes) ** 0.5
    entries = (
        f'[[subtask]]\nkind = "circle"\ncenter_mm = [{x:.2f}, {y:.2f}]\nradius_mm = {radius:.1f}\n'
        f"exposures = {exposures}\n"
        for x, y, radius, exposures in zip(
            generator.uniform(0, side_mm, holes),
            generator.uniform(0, side_mm, holes),
            generator.uniform(10, 60, holes),
            generator.integers(5, 15, holes),
            strict=True,
        )
    )
    return "".join(entries)


def least_time_s(task: str, repeats: int) -> float:
    """The least processor time of several runs, s."""
    times = []
    for _ in range(repeats):
        begun_s = time.process_time()
        remote.plan(task)
        times.append(time.process_time() - begun_s)
    return min(times)


if __name__ == "__main__":
    for name, task, repeats in (
        ("eight holes", EXCHANGER.read_text(encoding="utf-8"), 200),
        ("1000 holes", sheet(1000), 3),
        ("10 000 holes", sheet(10_000), 1),
    ):
        print(f"{name}: {1e3 * least_time_s(task, repeats):.2f} ms")
