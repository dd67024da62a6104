"""Marks in pairs of frames by OpenCV: difference, median blur, HoughCircles.

An oracle that shares no code with lasergym, and the usual way to do it (Xie et al. 2022, section
2.1, names the same three steps). It is told the radius, and that one mark is to be found; the
frames are registered by phase correlation first, and marks judged where the second frame shows
them.

    cargo run --release -p lasergym-machine --example detection -- lab 1000 --dump pairs 1000
    python tests/python/opencv_detection.py pairs

needs opencv-python-headless. Figures are counted as the example counts them.
"""

from __future__ import annotations

import csv
import math
import sys
import time
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

RADIUS_PX = 9.0
"""Radius of a mark, px of the pattern."""

RADIUS_RANGE_PX = 2.0
"""How far the radius may be from that, px of the pattern."""

MUST_SEE_PX = 10
"""A mark that newly machines this many pixels must be seen."""

SAME_MARK_PX = 3.0
"""A mark found within this distance of a true one is that one, px of the pattern."""


@dataclass(frozen=True)
class Circle:
    """A circle in a frame, frame px."""

    x: float
    y: float
    radius: float


def find_marks(
    before: np.ndarray, after: np.ndarray, scale: float, votes: float = 12.0
) -> list[Circle]:
    """Circles that have changed between two uint8 frames (height, width): the surest one, if any.

    `scale` is frame px per px of the pattern; `votes` is the accumulator threshold of HoughCircles.
    """
    (dx, dy), _ = cv2.phaseCorrelate(before.astype(np.float32), after.astype(np.float32))
    if math.hypot(dx, dy) > 10 * scale:
        dx = dy = 0.0
    height, width = before.shape
    move = np.array([[1.0, 0.0, dx], [0.0, 1.0, dy]])
    moved = cv2.warpAffine(before, move, (width, height), borderMode=cv2.BORDER_REPLICATE)
    difference = cv2.absdiff(moved, after)
    smooth = cv2.medianBlur(difference, 5)
    circles = cv2.HoughCircles(
        smooth,
        cv2.HOUGH_GRADIENT,
        dp=1,
        minDist=RADIUS_PX * scale,
        param1=60,
        param2=votes,
        minRadius=int((RADIUS_PX - RADIUS_RANGE_PX) * scale),
        maxRadius=int((RADIUS_PX + RADIUS_RANGE_PX) * scale),
    )
    if circles is None:
        return []
    return [Circle(*(float(value) for value in circle)) for circle in circles.reshape(-1, 3)[:1]]


@dataclass
class Figures:
    """What `judge` counts."""

    pairs: int = 0
    must_see: int = 0
    missed: int = 0
    seen: int = 0
    falsely: int = 0
    center_squares: float = 0.0
    radius_squares: float = 0.0
    matched: int = 0

    def report(self, times_s: list[float]) -> str:
        matched = max(self.matched, 1)
        median_s, slow_s = np.quantile(times_s, [0.5, 0.99])
        return "\n".join(
            [
                f"pairs             {self.pairs}",
                f"centre RMS        {math.sqrt(self.center_squares / matched):.3f} px",
                f"radius RMS        {math.sqrt(self.radius_squares / matched):.3f} px",
                f"missed            {100 * self.missed / max(self.must_see, 1):.3f} %"
                f" ({self.missed} of {self.must_see})",
                f"false             {100 * self.falsely / max(self.seen, 1):.3f} %"
                f" ({self.falsely} of {self.seen})",
                f"time for a pair   {1e3 * median_s:.3f} ms (median), {1e3 * slow_s:.3f} ms (99 %)",
            ]
        )


def judge(
    figures: Figures, circles: list[Circle], truths: list[tuple[Circle, int]], scale: float
) -> None:
    """Counts the circles of one pair against its true marks (circle, newly machined px)."""
    figures.pairs += 1
    free = list(range(len(truths)))

    def distance(circle: Circle, truth: Circle) -> float:
        return math.hypot(circle.x - truth.x, circle.y - truth.y) / scale

    for circle in circles:
        figures.seen += 1
        near = [(distance(circle, truths[k][0]), k) for k in free]
        best = min(near, default=(math.inf, -1))
        if best[0] > SAME_MARK_PX:
            figures.falsely += 1
            continue
        free.remove(best[1])
        figures.matched += 1
        figures.center_squares += best[0] ** 2
        figures.radius_squares += ((circle.radius - truths[best[1]][0].radius) / scale) ** 2
    for truth, new_px in truths:
        if new_px >= MUST_SEE_PX:
            figures.must_see += 1
            if all(distance(circle, truth) > SAME_MARK_PX for circle in circles):
                figures.missed += 1


def read_truth(folder: Path) -> tuple[dict[int, list[tuple[Circle, int]]], float]:
    """The true marks of each pair, and frame px per px of the pattern."""
    truths: dict[int, list[tuple[Circle, int]]] = defaultdict(list)
    scale = 1.0
    with (folder / "truth.csv").open(newline="") as file:
        for row in csv.DictReader(file):
            x, y = float(row["x_frame_px"]), float(row["y_frame_px"])
            circle = Circle(x, y, float(row["radius_frame_px"]))
            truths[int(row["pair"])].append((circle, int(row["new_px"])))
            scale = float(row["frame_px_per_px"])
    return truths, scale


def main(folder: Path) -> None:
    truths, scale = read_truth(folder)
    cv2.setNumThreads(1)
    for votes in (6.0, 9.0, 12.0, 16.0, 20.0):
        figures = Figures()
        times_s = []
        for path in sorted(folder.glob("*_before.png")):
            pair = int(path.name.split("_")[0])
            before = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
            after = cv2.imread(str(folder / f"{pair:05}_after.png"), cv2.IMREAD_GRAYSCALE)
            start = time.perf_counter()
            circles = find_marks(before, after, scale, votes)
            times_s.append(time.perf_counter() - start)
            judge(figures, circles, truths[pair], scale)
        print(f"accumulator threshold {votes:g}\n{figures.report(times_s)}\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
