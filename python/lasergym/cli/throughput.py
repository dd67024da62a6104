"""Steps per second, measured fairly: repetitions of all contestants take turns."""

import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass

from lasergym.cli.steppers import Stepper

__all__ = ["Throughput", "measure"]

_PATIENCE = 8.0
"""A contestant whose episodes take longer than this many least times is measured once."""


@dataclass(frozen=True)
class Throughput:
    """How fast one contestant steps.

    Attributes:
        task: ``"Star"`` or ``"RandomShape"``.
        num_envs: Number of environments.
        contestant: What was measured.
        threads: Worker threads.
        steps_per_s: Pulses fired in all environments per second, median of the repetitions.
        slowest_steps_per_s: The same of the slowest repetition.
        fastest_steps_per_s: The same of the fastest repetition.
        repetitions: Number of repetitions.
    """

    task: str
    num_envs: int
    contestant: str
    threads: int
    steps_per_s: float
    slowest_steps_per_s: float
    fastest_steps_per_s: float
    repetitions: int

    @property
    def step_ns(self) -> float:
        """Time of one step of one environment, ns."""
        return 1e9 / self.steps_per_s


def measure(steppers: Sequence[Stepper], *, seconds: float, repetitions: int) -> list[Throughput]:
    """Measures contestants in turns, so that all meet the same machine.

    Each repetition runs whole episodes (resets included) until ``seconds`` have passed. The first
    episodes of each contestant warm it up and do not count, unless they take very long.

    Args:
        steppers: The contestants.
        seconds: Least time of one repetition, s.
        repetitions: Repetitions of each contestant.
    """
    speeds: list[list[float]] = []
    slow: list[bool] = []
    for stepper in steppers:
        elapsed_s, speed = _run(stepper, 0.0)
        slow.append(elapsed_s > _PATIENCE * max(seconds, 0.05))
        speeds.append([speed] if slow[-1] else [])
    for _ in range(repetitions):
        for index, stepper in enumerate(steppers):
            if not slow[index]:
                speeds[index].append(_run(stepper, seconds)[1])
    return [
        Throughput(
            stepper.task,
            stepper.num_envs,
            stepper.contestant,
            stepper.threads,
            statistics.median(speed),
            min(speed),
            max(speed),
            len(speed),
        )
        for stepper, speed in zip(steppers, speeds, strict=True)
    ]


def _run(stepper: Stepper, seconds: float) -> tuple[float, float]:
    """(time, s; steps per second) of whole episodes that take at least ``seconds``."""
    steps = 0
    started_s = time.perf_counter()
    while True:
        steps += stepper.run_episodes()
        elapsed_s = time.perf_counter() - started_s
        if elapsed_s >= seconds:
            return elapsed_s, steps / elapsed_s
