"""The best offset of a robot line as a linear program, independent of the planner.

Variables are the offset and where each process begins. Scan circles are intersections of half
planes: wherever a solution leaves a circle, the tangent there is added, until none does.

``python tests/python/remote_linear_program.py 1000`` compares that many random tasks.
"""

from __future__ import annotations

import sys
import time

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from lasergym import remote

SPEED_MM_S = 200.0
MOST_ROUNDS = 200
LEAVES_MM = 1e-9


def line_length(circles: NDArray[np.float64], direction_deg: float, jump_s: float) -> float | None:
    """The least length of a line in a direction at full speed, mm; None where there is none.

    Args:
        circles: Rows of (x, y, radius, time).
        direction_deg: Direction of the line, °.
        jump_s: Time between processes, s.
    """
    angle = np.radians(direction_deg)
    across = circles[:, 0] * np.sin(angle) - circles[:, 1] * np.cos(angle)
    along = circles[:, 0] * np.cos(angle) + circles[:, 1] * np.sin(angle)
    radius, length = circles[:, 2], SPEED_MM_S * circles[:, 3]
    count = len(circles)
    objective = np.zeros(count + 1)
    objective[1] -= 1
    objective[count] += 1
    order = np.zeros((count - 1, count + 1))
    for k in range(count - 1):
        order[k, k + 1], order[k, k + 2] = 1, -1
    rows, limits = [order], [-(length[:-1] + SPEED_MM_S * jump_s)]

    def tangents(index: int, end: int, turn: NDArray[np.float64]) -> None:
        """Half planes of circle `index` at the angles `turn`, for its process's start or end."""
        made = np.zeros((len(turn), count + 1))
        made[:, 0], made[:, 1 + index] = np.cos(turn), np.sin(turn)
        rows.append(made)
        shift = length[index] if end else 0.0
        limits.append(
            radius[index] + np.cos(turn) * across[index] + np.sin(turn) * (along[index] - shift)
        )

    for index in range(count):
        for end in (0, 1):
            tangents(index, end, np.arange(16) * np.pi / 8)
    for _ in range(MOST_ROUNDS):
        found = linprog(
            objective,
            A_ub=np.concatenate(rows),
            b_ub=np.concatenate(limits),
            bounds=(None, None),
            method="highs",
            options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
        )
        if found.status == 2:
            return None
        assert found.status == 0, found.message
        inside = True
        for index in range(count):
            for end in (0, 1):
                x = found.x[0] - across[index]
                y = found.x[1 + index] + (length[index] if end else 0.0) - along[index]
                if np.hypot(x, y) > radius[index] + LEAVES_MM:
                    tangents(index, end, np.array([np.arctan2(y, x)]))
                    inside = False
        if inside:
            break
    return float(found.fun + length[-1])


def random_circles(generator: np.random.Generator) -> tuple[NDArray[np.float64], float]:
    """Two to twelve scan circles roughly in a row, and a direction roughly along it, °."""
    count = int(generator.integers(2, 13))
    direction_deg = generator.uniform(0, 360)
    along = np.cumsum(generator.uniform(20, 200, count))
    across = generator.uniform(-45, 45, count)
    angle = np.radians(direction_deg + generator.normal(0, 3))
    x = along * np.cos(angle) - across * np.sin(angle)
    y = along * np.sin(angle) + across * np.cos(angle)
    radius = generator.uniform(40, 140, count)
    time_s = generator.uniform(0.02, 0.5, count)
    return np.stack([x, y, radius, time_s], axis=1), direction_deg


def compare(tasks: int, seed: int = 0) -> tuple[int, int, float]:
    """Compares the planner with the linear program.

    Returns:
        Tasks with a line, tasks on whose feasibility both disagree, and the largest difference in
        length, mm.
    """
    generator = np.random.default_rng(seed)
    feasible, disagreements, largest_mm = 0, 0, 0.0
    for index in range(tasks):
        circles, direction_deg = random_circles(generator)
        jump_s = 0.02 if index % 2 else 0.0
        line = remote.best_line(
            circles,
            direction_deg=direction_deg,
            slowest_mm_s=SPEED_MM_S,
            fastest_mm_s=SPEED_MM_S,
            jump_s=jump_s,
        )
        expected_mm = line_length(circles, direction_deg, jump_s)
        if line is None or expected_mm is None:
            disagreements += (line is None) != (expected_mm is None)
            continue
        feasible += 1
        largest_mm = max(largest_mm, abs(line.length_mm - expected_mm))
    return feasible, disagreements, largest_mm


if __name__ == "__main__":
    number = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    begun_s = time.perf_counter()
    lines, differing, worst_mm = compare(number)
    print(f"{number} tasks, {lines} with a line, {differing} disagreements")
    print(f"largest difference in length: {worst_mm:.2e} mm")
    print(f"{time.perf_counter() - begun_s:.0f} s")
