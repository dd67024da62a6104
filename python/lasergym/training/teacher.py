"""Jobs in progress from which a spatial policy learns what its next pulse costs in the end."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from lasergym import _native
from lasergym.errors import OptionError
from lasergym.options import integer_in
from lasergym.targets import SIZE_PX
from lasergym.training.spatial_decision import (
    CORRECTION_REACH_PX,
    CORRECTION_WIDTH,
    LAYER_SCALES_PX,
    RING_WEIGHT,
    VIEW_SIZE,
)

__all__ = [
    "FIRST_VALIDATION_SEED",
    "LEAST_CANDIDATES",
    "Lesson",
    "Teacher",
    "TeacherTask",
]

FIRST_VALIDATION_SEED = 1_990_000_000
"""Random shapes from this seed on serve validation, and from 2 000 000 000 on evaluation only."""

LEAST_CANDIDATES = 8
"""Fewest candidates of a lesson."""


class TeacherTask(Enum):
    """Where the targets come from, and how many pulses they have."""

    STAR = "star"
    """The upright star with 40 to 45 pulses."""
    ROTATED_STAR = "rotated_star"
    """Stars turned by any angle with 40 to 45 pulses."""
    RANDOM_SHAPE = "random_shape"
    """Random shapes with area / 125 ± 10 % pulses."""


@dataclass(frozen=True)
class Lesson:
    """What the teacher says about one pulse of each of n jobs.

    Attributes:
        views: What the network sees, float32, shape (n, 18, 28, 28).
        offsets: Candidates, as rows and columns from the place of best ring score; int64, shape
            (n, candidates, 2), each from −8 to 8.
        scores_px: Their ring scores, float32, shape (n, candidates).
        values_px: What the pulses that are left gain together with them, float32, shape (n,
            candidates).
    """

    views: NDArray[np.float32]
    offsets: NDArray[np.int64]
    scores_px: NDArray[np.float32]
    values_px: NDArray[np.float32]


class Teacher:
    """Jobs that a policy does, and a planner that says what its choices cost.

    For every candidate for the next pulse the rest of the job is planned around it, by Metropolis
    moves from the best plan known. The value of the candidate is what it and the pulses after it
    gain together, hits − misses, px.
    """

    def __init__(self, task: TeacherTask, jobs: int, seed: int, moves: int = 3000) -> None:
        """Begins the jobs.

        Args:
            task: Their targets.
            jobs: How many go on side by side, at least 1.
            seed: Seed of everything random. Job k draws its targets from the stream of
                ``seed + k``, whose first one is the random shape of that seed, so that all are
                below :data:`FIRST_VALIDATION_SEED`.
            moves: Metropolis moves by which the other pulses give way to a candidate.

        Raises:
            OptionError: A figure is outside its range.
        """
        most = FIRST_VALIDATION_SEED - integer_in("jobs", jobs, 1, 1_000_000)
        if not 0 <= seed <= most:
            raise OptionError(
                f"seed is {seed}, but must be from 0 to {most}: later shapes are held out"
            )
        pulses = None if task is TeacherTask.RANDOM_SHAPE else (40, 45)
        self._native = _native.Teacher(task.value, jobs, seed, moves, pulses)
        self._generator = np.random.default_rng(seed)
        self.jobs = jobs

    def observe(self) -> NDArray[np.float32]:
        """What the network sees of every job, shape (jobs, 18, 28, 28)."""
        return self._native.observe()[0]

    def teach(self, corrections_px: NDArray[np.float32], candidates: int = 14) -> Lesson:
        """Judges candidates about what the policy would do.

        Args:
            corrections_px: The policy's corrections, shape (jobs, 17, 17), px.
            candidates: How many are judged in each job, at least 8: the place of best ring score,
                the policy's choice, the planned pulse, and others drawn about these and by the
                policy's own odds.

        Returns:
            The candidates and what they are worth.

        Raises:
            OptionError: There are too few candidates.
        """
        integer_in("candidates", candidates, LEAST_CANDIDATES, CORRECTION_WIDTH**2)
        views, places = self._native.observe()
        scores_px, legal = _scores(views, places)
        odds = np.where(legal, scores_px + corrections_px, -np.inf).reshape(self.jobs, -1)
        own = _offsets(odds.argmax(1))
        planned = self._native.planned() - places
        planned = np.where((np.abs(planned) > CORRECTION_REACH_PX).any(1)[:, None], own, planned)
        offsets = np.empty((self.jobs, candidates, 2), np.int64)
        drawn, near = (candidates - 3 + 1) // 2, (candidates - 3) // 4
        noise = self._generator.gumbel(size=(self.jobs, drawn, odds.shape[1])) * 3.0
        offsets[:, 0], offsets[:, 1], offsets[:, 2] = 0, own, planned
        offsets[:, 3 : 3 + drawn] = _offsets((odds[:, None] + noise).argmax(2))
        first = 3 + drawn
        shape = (self.jobs, candidates - first, 2)
        scatter = self._generator.normal(size=shape)
        offsets[:, first:] = own[:, None] + np.rint(scatter * 2.5).astype(np.int64)
        offsets[:, first : first + near] = planned[:, None] + np.rint(
            scatter[:, :near] * 1.2
        ).astype(np.int64)
        offsets = offsets.clip(-CORRECTION_REACH_PX, CORRECTION_REACH_PX)
        pixels = (places[:, None] + offsets).clip(0, SIZE_PX - 1)
        offsets = pixels - places[:, None]
        rows = np.arange(self.jobs)[:, None]
        cells = offsets + CORRECTION_REACH_PX
        return Lesson(
            views,
            offsets,
            scores_px[rows, cells[..., 0], cells[..., 1]],
            self._native.values(pixels).astype(np.float32),
        )

    def fire(
        self, corrections_px: NDArray[np.float32], lesson: Lesson, explore: float = 0.2
    ) -> NDArray[np.float64]:
        """Fires one pulse in every job: mostly the policy's choice.

        Args:
            corrections_px: The policy's corrections, shape (jobs, 17, 17), px.
            lesson: What :meth:`teach` just said.
            explore: Share of the jobs, in [0, 1], that fire another candidate that gains anything:
                half of them the best one, half any.

        Returns:
            Gain over area of the jobs that end by it, where new jobs begin; NaN elsewhere.
        """
        forced = corrections_px.copy()
        others = self._generator.random(self.jobs)
        best = lesson.values_px.argmax(1)
        anyone = self._generator.integers(lesson.offsets.shape[1], size=self.jobs)
        for job in np.flatnonzero(others < explore):
            choice = best[job] if others[job] < explore / 2 else anyone[job]
            row, column = lesson.offsets[job, choice] + CORRECTION_REACH_PX
            forced[job] = 0
            forced[job, row, column] = 1e6
        return self._native.fire(forced)


def _offsets(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """Rows and columns from the middle of cells counted row by row; shape (..., 2)."""
    rows_columns = np.stack([cells // CORRECTION_WIDTH, cells % CORRECTION_WIDTH], -1)
    return rows_columns - CORRECTION_REACH_PX


def _scores(
    views: NDArray[np.float32], places: NDArray[np.int64]
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Ring scores at all offsets, shape (jobs, 17, 17), px, and where a policy may fire.

    These are the places on the workpiece that gain anything, and the one of best ring score.
    """
    jobs = len(views)
    # Undoes the order of PixelUnshuffle: (layer, row parity, column parity, row, column).
    size, whole = VIEW_SIZE, 2 * VIEW_SIZE
    layers = views[:, :16].reshape(jobs, 4, 2, 2, size, size).transpose(0, 1, 4, 2, 5, 3)
    # The candidate lies in row and column 28.
    window = slice(size - CORRECTION_REACH_PX, size + CORRECTION_REACH_PX + 1)
    seen = layers.reshape(jobs, 4, whole, whole)[:, :, window, window]
    gains, rings = (np.float32(LAYER_SCALES_PX[k]) * seen[:, k] for k in (2, 3))
    steps = np.arange(-CORRECTION_REACH_PX, CORRECTION_REACH_PX + 1)
    inside = [(places[:, [k]] + steps >= 0) & (places[:, [k]] + steps < SIZE_PX) for k in (0, 1)]
    legal = inside[0][:, :, None] & inside[1][:, None, :] & (gains > 0)
    legal[:, CORRECTION_REACH_PX, CORRECTION_REACH_PX] = True
    return gains - np.float32(RING_WEIGHT) * rings, legal
