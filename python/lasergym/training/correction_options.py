"""Settings of learning from the planner, and how far it has come."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from lasergym.errors import OptionError
from lasergym.training.teacher import LEAST_CANDIDATES, TeacherTask

__all__ = ["CorrectionOptions", "LessonProgress"]


@dataclass(frozen=True)
class CorrectionOptions:
    """Settings of a training; together with the seed they determine it.

    Attributes:
        tasks: Targets to learn from, in turn.
        updates: Updates of the network, at least 1.
        updates_per_lesson: Updates between two pulses of all jobs, at least 1.
        jobs: Jobs of each task that go on side by side, at least 1.
        candidates: Candidates judged for each pulse, at least 8.
        moves: Metropolis moves for each candidate.
        batch_size: Samples of an update, each a view with all its candidates.
        capacity: Samples that are kept to learn from; 30 kB each.
        learning_rate: At the beginning; it falls to 1 % along a cosine.
        channels: Width of the network.
        lessons_per_judgement: Lessons between two judgements, with a checkpoint and a report each,
            at least 1.
        validation_targets: Targets of each task that judge the network, at least 1; the upright
            star always comes with its six pulse budgets.
        seed: Seed of network, jobs and batches.
    """

    tasks: tuple[TeacherTask, ...] = (TeacherTask.RANDOM_SHAPE,)
    updates: int = 6000
    updates_per_lesson: int = 14
    jobs: int = 256
    candidates: int = 14
    moves: int = 3000
    batch_size: int = 128
    capacity: int = 60_000
    learning_rate: float = 2e-3
    channels: int = 32
    lessons_per_judgement: int = 20
    validation_targets: int = 60
    seed: int = 0

    def __post_init__(self) -> None:
        """Checks the ranges.

        Raises:
            OptionError: A figure is outside its range.
        """
        least = {"candidates": LEAST_CANDIDATES, "seed": 0}
        for name, value in asdict(self).items():
            if name != "tasks" and value < least.get(name, 1) and name != "learning_rate":
                raise OptionError(f"{name} is {value}, but must be at least {least.get(name, 1)}")
        if not self.tasks:
            raise OptionError("tasks is empty: name at least one")
        if not 0 < self.learning_rate < 1:
            raise OptionError(f"learning_rate is {self.learning_rate}, but must be in (0, 1)")


@dataclass(frozen=True)
class LessonProgress:
    """How far a training has come.

    Attributes:
        updates: Updates done.
        total_updates: Updates of the whole training.
        samples: Samples made so far, each a pulse of a job with its candidates.
        loss: Running mean of the loss, px.
        regret_px: What the policy's choices gave away against the best candidate, px, on average
            over the last lesson.
        heuristic_regret_px: The same of the places of best ring score.
        returns: Gain over area of the jobs that have ended since the last report.
        validation_gain: Mean gain over area on the validation targets, as the policy is deployed.
        best_validation_gain: The best so far.
        teaching_s: Time spent on lessons so far, s.
        elapsed_s: Time so far, s.
        remaining_s: Time that is probably left, s; None before the first update.
    """

    updates: int
    total_updates: int
    samples: int
    loss: float
    regret_px: float
    heuristic_regret_px: float
    returns: tuple[float, ...]
    validation_gain: float
    best_validation_gain: float
    teaching_s: float
    elapsed_s: float
    remaining_s: float | None
