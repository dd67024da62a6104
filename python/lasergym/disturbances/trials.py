"""One disturbed job, and what could still be achieved after its disturbance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal, TypeAlias

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import lasergym
from lasergym import _native
from lasergym.envs import AblationEnv
from lasergym.machine import Deciding
from lasergym.planners import Score
from lasergym.targets import SIZE_PX, Target

__all__ = [
    "CONTINUOUS",
    "DISPLACED_PULSE",
    "GRID_SIDE",
    "DisturbanceName",
    "Trial",
    "TrialResult",
    "grid_position_px",
    "run_trial",
]

DisturbanceName: TypeAlias = Literal["displaced", "vibration", "backlash", "drift", "misfire"]
"""What keeps pulses from landing where they are aimed."""

CONTINUOUS: dict[DisturbanceName, str] = {
    "vibration": "vibration_px",
    "backlash": "backlash_px",
    "drift": "drift_px_per_pulse",
    "misfire": "misfire_probability",
}
"""Disturbances of every pulse, and the quantity of which there is more or less."""

DISPLACED_PULSE = 5
"""The pulse that is displaced, as in Fig. 8 of Xie et al. (2022)."""

GRID_SIDE = 25
"""Rows and columns of the positions to which it is displaced."""


@dataclass(frozen=True, order=True)
class Trial:
    """A disturbed job.

    Attributes:
        disturbance: What is disturbed.
        shape: Name of the target.
        contestant: Who decides: ``closed`` (sees every pulse), ``open`` (the same planner's plan,
            fired as it is), ``cma-es`` (the plan of CMA-ES, fired as it is), or ``anneal`` (plans
            again after every pulse).
        level: How much, px or probability; for a displaced pulse, the number of its position.
        seed: Seed of the disturbance.
    """

    disturbance: DisturbanceName
    shape: str
    contestant: str
    level: float
    seed: int


@dataclass(frozen=True)
class TrialResult:
    """What a disturbed job has achieved.

    Attributes:
        trial: The job.
        score: Reward, fractions and pulses.
        best_reward: The best reward that was still possible after a displaced pulse; NaN for
            other disturbances.
    """

    trial: Trial
    score: Score
    best_reward: float


def grid_position_px(number: int) -> tuple[float, float]:
    """Position of the displaced pulse, px: row by row over the workpiece."""
    row, column = divmod(number, GRID_SIDE)
    step_px = SIZE_PX / GRID_SIDE
    return (column + 0.5) * step_px, (row + 0.5) * step_px


def run_trial(
    trial: Trial,
    target: Target,
    deciding: Callable[[], Deciding],
    *,
    max_pulses: int,
    completion_iterations: int,
) -> TrialResult:
    """Does a disturbed job.

    Args:
        trial: The job.
        target: Boolean array of shape (100, 100).
        deciding: Makes who decides.
        max_pulses: Most pulses.
        completion_iterations: Metropolis moves for the best completion after a displaced pulse.
    """
    disturbance: dict[str, Any] = {"displaced": None, **dict.fromkeys(CONTINUOUS.values(), 0.0)}
    if trial.disturbance == "displaced":
        place = grid_position_px(int(trial.level))
        disturbance["displaced"] = (DISPLACED_PULSE, *place)
    else:
        disturbance[CONTINUOUS[trial.disturbance]] = trial.level
    _, landed, figures = _native.disturbed_job(
        target, 9.0, max_pulses, deciding().settings(), disturbance, trial.seed
    )
    score = Score(*figures)
    best = float("nan")
    if trial.disturbance == "displaced":
        first = landed[:DISPLACED_PULSE]
        best = max(
            score.reward,
            _best_reward(
                target.tobytes(), first.tobytes(), max_pulses - len(first), completion_iterations
            ),
        )
    return TrialResult(trial, score, best)


@cache
def _best_reward(target: bytes, landed_px: bytes, pulses_left: int, iterations: int) -> float:
    """Reward of the landed pulses and of the best completion, by greedy and by annealing."""
    pattern = np.frombuffer(target, np.bool_).reshape(SIZE_PX, SIZE_PX)
    first: NDArray[np.float64] = np.frombuffer(landed_px).reshape(-1, 2)
    env = gym.make(
        "lasergym/Pattern-v0",
        target=pattern,
        max_pulses=len(first) + 1,
        completion=1.0,
        disable_env_checker=True,
    ).unwrapped
    assert isinstance(env, AblationEnv)
    env.reset(seed=0)
    reward = 0.0
    for action in (first / (SIZE_PX / 2) - 1).astype(np.float32):
        _, gain, terminated, _, _ = env.step(action)
        reward += float(gain)
        if terminated:
            return reward
    remaining, forbidden = env.remaining(), env.forbidden()
    if pulses_left <= 0 or not remaining.any():
        return reward
    plans = [
        lasergym.plan(remaining, "greedy", max_pulses=pulses_left, forbidden=forbidden),
        lasergym.plan(
            remaining,
            "anneal",
            max_pulses=pulses_left,
            forbidden=forbidden,
            iterations=iterations,
        ),
    ]
    return reward + max(0.0, *(plan.reward for plan in plans))
