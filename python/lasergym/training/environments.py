"""The environments of a run, as Stable-Baselines3 sees them."""

from __future__ import annotations

import time

from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper, VecNormalize
from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn

from lasergym.sb3 import ThinnedPixels, make_vec_env
from lasergym.training.config import TaskConfig

__all__ = ["Stopwatch", "make_environments", "normalised"]


class Stopwatch(VecEnvWrapper):
    """Measures the time that is spent in the environments.

    Attributes:
        elapsed_s: Time in ``reset`` and ``step`` so far, s.
    """

    def __init__(self, venv: VecEnv) -> None:
        """Wraps ``venv`` without changing anything."""
        super().__init__(venv)
        self.elapsed_s = 0.0

    def reset(self) -> NDArray:  # type: ignore[type-arg]
        """The first observations."""
        started_s = time.perf_counter()
        observations = self.venv.reset()
        self.elapsed_s += time.perf_counter() - started_s
        return observations  # type: ignore[return-value]

    def step_wait(self) -> VecEnvStepReturn:
        """The next observations."""
        started_s = time.perf_counter()
        results = self.venv.step_wait()
        self.elapsed_s += time.perf_counter() - started_s
        return results


def make_environments(task: TaskConfig, seed: int, count: int | None = None) -> Stopwatch:
    """Native environments with thinned observations and a stopwatch, without a normaliser.

    Args:
        task: What is trained on.
        seed: Environment ``i`` is seeded with ``seed + i``.
        count: Environments; by default those of the task.
    """
    venv: VecEnv = make_vec_env(
        task.env_id, count or task.environments, seed, threads=task.threads, **task.process()
    )
    if task.thinning > 1:
        venv = ThinnedPixels(venv, task.thinning)
    return Stopwatch(venv)


def normalised(venv: VecEnv, task: TaskConfig, gamma: float) -> VecNormalize | None:
    """Environments whose observations or rewards are normalised; None where the task wants neither.

    The normaliser holds running means and deviations, as in Xie et al. (2022), section 2.2.
    """
    if not (task.normalise_observations or task.normalise_rewards):
        return None
    return VecNormalize(
        venv,
        norm_obs=task.normalise_observations,
        norm_reward=task.normalise_rewards,
        gamma=gamma,
    )
