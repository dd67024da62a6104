"""The whole study: shapes, disturbances and contestants, results on disk, summary."""

from __future__ import annotations

import csv
import math
import os
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import numpy as np

import lasergym
from lasergym import targets
from lasergym.comparison import Progress
from lasergym.disturbances.trials import (
    CONTINUOUS,
    GRID_SIDE,
    DisturbanceName,
    Trial,
    TrialResult,
    run_trial,
)
from lasergym.errors import OptionError
from lasergym.machine import DeciderName, Deciding
from lasergym.planners import Plan, Score
from lasergym.policy import Policy
from lasergym.targets import Target

__all__ = ["CONTESTANTS", "Study", "StudyOptions", "run_study"]

CONTESTANTS: dict[str, str] = {
    "closed": "closed loop",
    "open": "the same planner, open loop",
    "cma-es": "CMA-ES, open loop",
    "anneal": "annealing again after each pulse",
}
"""Contestants, and what figures call them."""

_LEVELS: dict[DisturbanceName, tuple[float, ...]] = {
    "vibration": (0.0, 1.0, 2.0, 3.0, 4.0, 5.0),
    "backlash": (0.0, 1.0, 2.0, 3.0, 4.0, 5.0),
    "drift": (0.0, 0.02, 0.04, 0.06, 0.08, 0.1),
    "misfire": (0.0, 0.02, 0.04, 0.06, 0.08, 0.1),
}

_COLUMNS = (
    *("disturbance", "shape", "contestant", "level", "seed"),
    *("reward", "machined_fraction", "off_target_fraction", "pulses", "best_reward"),
)


@dataclass(frozen=True, kw_only=True)
class StudyOptions:
    """What is studied.

    Attributes:
        planner: Planner of the contestants ``closed`` and ``open``.
        policy: Policy of ``"policy"`` and ``"agent-mpc"``: a shipped name or a file.
        positions: Positions of the grid to which the 5th pulse is displaced, in steps: 1 takes all
            25 × 25, 5 every fifth row and column.
        seeds: Jobs for each level of the other disturbances.
        max_pulses: Most pulses of a job.
        first_iterations: Metropolis moves of the first plan of annealing planners.
        moves: Metropolis moves before each pulse.
        completion_iterations: Metropolis moves for the best that is still possible.
        cma_es_evaluations: Evaluations of CMA-ES on each shape.
        shapes: Names of shapes to take; all by default.
    """

    planner: DeciderName = "agent-mpc"
    policy: str | None = None
    positions: int = 1
    seeds: int = 20
    max_pulses: int = 45
    first_iterations: int = 300_000
    moves: int = 5000
    completion_iterations: int = 100_000
    cma_es_evaluations: int = 100_000
    shapes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Refuses values out of range."""
        for name, most in {"positions": GRID_SIDE, "seeds": 10_000, "max_pulses": 10_000}.items():
            if not 1 <= getattr(self, name) <= most:
                raise OptionError(f"{name} is {getattr(self, name)}, but must be from 1 to {most}")
        unknown = set(self.shapes) - set(_shapes())
        if unknown:
            raise OptionError(f"there is no shape {unknown}: use some of {', '.join(_shapes())}")


@dataclass(frozen=True)
class Study:
    """What a study has found.

    Attributes:
        results: The results, in order.
        files: What was written.
    """

    results: tuple[TrialResult, ...]
    files: tuple[Path, ...] = field(default=())

    def displaced(self, contestant: str) -> dict[str, float]:
        """Figures of a contestant whose 5th pulse was displaced.

        Returns:
            ``positions``; ``within_0_01``, the fraction whose reward is within 0.01 of the best
            that was still possible; ``machined_95``, the fraction with 95 % of the target machined;
            the mean ``reward``, ``machined_fraction`` and ``off_target_fraction``; ``worst_loss``.
        """
        found = [
            one
            for one in self.results
            if one.trial.disturbance == "displaced" and one.trial.contestant == contestant
        ]
        if not found:
            return {"positions": 0.0}
        losses = np.array([one.best_reward - one.score.reward for one in found])
        machined = np.array([one.score.machined_fraction for one in found])
        return {
            "positions": float(len(found)),
            "within_0_01": float((losses <= 0.01).mean()),
            "machined_95": float((machined >= 0.95).mean()),
            "reward": float(np.mean([one.score.reward for one in found])),
            "machined_fraction": float(machined.mean()),
            "off_target_fraction": float(np.mean([one.score.off_target_fraction for one in found])),
            "worst_loss": float(losses.max()),
        }

    def mean_reward(self, disturbance: str, contestant: str) -> dict[float, float]:
        """Mean reward of a contestant by the level of a disturbance."""
        by_level: dict[float, list[float]] = {}
        for one in self.results:
            if (one.trial.disturbance, one.trial.contestant) == (disturbance, contestant):
                by_level.setdefault(one.trial.level, []).append(one.score.reward)
        return {level: float(np.mean(rewards)) for level, rewards in sorted(by_level.items())}


def run_study(
    options: StudyOptions,
    output: str | os.PathLike[str],
    progress: Callable[[Progress], None] | None = None,
) -> Study:
    """Studies how jobs get over disturbances.

    Results are written as they come: called again with the same options and folder, the study goes
    on where it was killed.

    Args:
        options: What is studied.
        output: Folder for ``results.csv``; made where missing.
        progress: Called after each trial.

    Raises:
        OptionError: The folder has results of other options.
    """
    folder = Path(output)
    folder.mkdir(parents=True, exist_ok=True)
    _check_settings(folder / "settings.txt", repr(options))
    shapes = {name: shape for name, shape in _shapes().items() if _wanted(options, name)}
    trials = list(_trials(options, shapes))
    path = folder / "results.csv"
    results = _read(path)
    contestants = _Contestants(options, shapes)
    began_s, at_first = time.monotonic(), len(results)
    with path.open("a", newline="", encoding="utf-8") as file:
        for trial in trials:
            if trial not in results:
                results[trial] = run_trial(
                    trial,
                    shapes[trial.shape],
                    lambda trial=trial: contestants.deciding(trial),  # type: ignore[misc]
                    max_pulses=options.max_pulses,
                    completion_iterations=options.completion_iterations,
                )
                _write(file, results[trial])
            if progress is not None:
                made = len(results) - at_first
                left_s = None
                if made > 0:
                    left_s = (time.monotonic() - began_s) / made * (len(trials) - len(results))
                progress(Progress(len(results), len(trials), left_s))
    return Study(tuple(results[trial] for trial in trials), (path,))


class _Contestants:
    """Who decides in a trial; plans of open loops are made once for each shape."""

    def __init__(self, options: StudyOptions, shapes: Mapping[str, Target]) -> None:
        self._options = options
        self._shapes = shapes
        self._policy = None
        if options.planner in ("policy", "agent-mpc"):
            self._policy = Policy.load(options.policy or "random-shape")
        self._plans: dict[tuple[str, str], Plan | np.ndarray[tuple[int, int], np.dtype[np.float64]]]
        self._plans = {}

    def deciding(self, trial: Trial) -> Deciding:
        options = self._options
        moves, first = options.moves, options.first_iterations
        if trial.contestant == "closed":
            return self._planner()
        if trial.contestant == "anneal":
            return Deciding(planner="anneal", first_iterations=first, moves=moves)
        key = (trial.contestant, trial.shape)
        if key not in self._plans:
            self._plans[key] = self._plan(trial)
        return Deciding(planner="fixed", plan=self._plans[key])

    def _planner(self) -> Deciding:
        options = self._options
        return Deciding(
            planner=options.planner,
            policy=self._policy,
            first_iterations=options.first_iterations,
            moves=options.moves,
        )

    def _plan(self, trial: Trial) -> Plan | np.ndarray[tuple[int, int], np.dtype[np.float64]]:
        target, options = self._shapes[trial.shape], self._options
        if trial.contestant == "cma-es":
            return lasergym.plan(
                target,
                "cma-es",
                max_pulses=options.max_pulses,
                iterations=options.cma_es_evaluations,
            )
        calm = {"displaced": None, **dict.fromkeys(CONTINUOUS.values(), 0.0)}
        aimed, _, _ = lasergym._native.disturbed_job(
            target, 9.0, options.max_pulses, self._planner().settings(), calm, 0
        )
        return aimed


def _shapes() -> dict[str, Target]:
    """The shapes of Fig. 8 of Xie et al. (2022), and two random ones, by name."""
    x_px, y_px = np.meshgrid(np.arange(100) + 0.5, np.arange(100) + 0.5)
    ellipse = ((x_px - 50) / 45) ** 2 + ((y_px - 50) / 30) ** 2 <= 1
    return {
        "ellipse": ellipse,
        "thumbs-up": _thumbs_up(),
        "star": targets.star(),
        "random-shape-1": targets.random_shape(2_000_000_001),
        "random-shape-2": targets.random_shape(2_000_000_002),
    }


def _thumbs_up() -> Target:
    """A hand with its thumb up."""
    x_px, y_px = np.meshgrid(np.arange(100) + 0.5, np.arange(100) + 0.5)
    cuff = (abs(x_px - 14) <= 9) & (abs(y_px - 70) <= 24)
    fist = (abs(x_px - 60) <= 32) & (abs(y_px - 68) <= 26)
    thumb = np.hypot(x_px - 55 - (y_px - 30) * -0.15, (y_px - 25) * 0.55) <= 12
    return np.asarray(cuff | fist | thumb)


def _wanted(options: StudyOptions, shape: str) -> bool:
    return not options.shapes or shape in options.shapes


def _trials(options: StudyOptions, shapes: Mapping[str, Target]) -> Iterator[Trial]:
    for shape in shapes:
        for contestant in CONTESTANTS:
            for row in range(0, GRID_SIDE, options.positions):
                for column in range(0, GRID_SIDE, options.positions):
                    number = float(row * GRID_SIDE + column)
                    yield Trial("displaced", shape, contestant, number, 0)
    for disturbance, levels in _LEVELS.items():
        for shape in shapes:
            for contestant in CONTESTANTS:
                for level in levels:
                    for seed in range(options.seeds if level > 0 else 1):
                        yield Trial(disturbance, shape, contestant, level, seed)


def _check_settings(path: Path, settings: str) -> None:
    settings = f"{lasergym.__version__} {settings}\n"
    if path.exists() and path.read_text(encoding="utf-8") != settings:
        raise OptionError(f"{path.parent} has results of other options: give another folder")
    path.write_text(settings, encoding="utf-8")


def _write(file: IO[str], result: TrialResult) -> None:
    trial, score = result.trial, result.score
    csv.writer(file).writerow(
        [
            *(trial.disturbance, trial.shape, trial.contestant, trial.level, trial.seed),
            *(score.reward, score.machined_fraction, score.off_target_fraction, score.pulses),
            result.best_reward,
        ]
    )
    file.flush()


def _read(path: Path) -> dict[Trial, TrialResult]:
    """The results of an earlier run; a last line that was cut off is dropped."""
    if not path.exists():
        path.write_text(",".join(_COLUMNS) + "\r\n", encoding="utf-8")
        return {}
    whole = path.read_bytes()
    kept = whole[: whole.rfind(b"\n") + 1]
    if kept != whole:
        path.write_bytes(kept)
    results: dict[Trial, TrialResult] = {}
    for row in csv.DictReader(kept.decode("utf-8").splitlines()):
        trial = Trial(
            row["disturbance"],  # type: ignore[arg-type]
            row["shape"],
            row["contestant"],
            float(row["level"]),
            int(row["seed"]),
        )
        score = Score(
            float(row["reward"]),
            float(row["machined_fraction"]),
            float(row["off_target_fraction"]),
            int(row["pulses"]),
        )
        best = float(row["best_reward"])
        results[trial] = TrialResult(trial, score, best if math.isfinite(best) else math.nan)
    return results
