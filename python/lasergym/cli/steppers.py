"""The contestants of the benchmark: whoever fires a random pulse in every environment."""

import importlib.util
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import gymnasium as gym
import numpy as np
from gymnasium.vector import SyncVectorEnv

from lasergym import targets
from lasergym.errors import OptionError

__all__ = ["EPISODE_STEPS", "Stepper", "changed_px", "make_steppers", "shape_time_us"]

EPISODE_STEPS = 45
"""Pulses of an episode; random ones never complete a target before."""

_Step: TypeAlias = Callable[[Any], Any]


@dataclass(frozen=True, eq=False)
class Stepper:
    """Environments that have been reset, and how to step them.

    Attributes:
        task: ``"Star"`` or ``"RandomShape"``.
        num_envs: Number of environments.
        contestant: What is measured.
        threads: Worker threads.
        step: Fires a pulse everywhere; actions are float32 of shape (num_envs, 2). The call
            after the last pulse of the episodes resets them.
        actions: Random actions, float32 of shape (EPISODE_STEPS + 1, num_envs, 2).
    """

    task: str
    num_envs: int
    contestant: str
    threads: int
    step: _Step
    actions: Any

    def run_episodes(self) -> int:
        """Runs one episode everywhere, resets included; the number of pulses fired."""
        step = self.step
        for actions in self.actions:
            step(actions)
        return EPISODE_STEPS * self.num_envs


def make_steppers(
    task: str,
    num_envs: int,
    *,
    threads: int,
    numpy_oracle: Path | None,
    sync_max_envs: int,
) -> list[Stepper]:
    """The contestants of one task and number of environments, the reference first.

    Args:
        task: ``"Star"`` or ``"RandomShape"``.
        num_envs: Number of environments.
        threads: Worker threads of the contestant that uses all.
        numpy_oracle: Python file with the classes ``NumpyAblation`` and
            ``WholeGridNumpyAblation``, where there is one.
        sync_max_envs: ``SyncVectorEnv`` and the whole grid take part up to this number of
            environments.
    """
    generator = np.random.default_rng(0)
    shape = (EPISODE_STEPS + 1, num_envs, 2)
    actions = generator.uniform(-1, 1, shape).astype(np.float32)

    def stepper(contestant: str, step: _Step, threads: int = 1) -> Stepper:
        return Stepper(task, num_envs, contestant, threads, step, actions)

    env_id = f"lasergym/{task}-v0"
    steppers = [stepper("lasergym", _native(env_id, num_envs, 1, copy=False))]
    if threads > 1:
        step = _native(env_id, num_envs, threads, copy=False)
        steppers.append(stepper("lasergym", step, threads))
    steppers.append(stepper("lasergym, copy=True", _native(env_id, num_envs, 1, copy=True)))
    if numpy_oracle is not None:
        windowed = _numpy(numpy_oracle, "NumpyAblation", task, num_envs)
        steppers.append(stepper("NumPy, window", windowed))
    if num_envs <= sync_max_envs:
        if numpy_oracle is not None:
            whole = _numpy(numpy_oracle, "WholeGridNumpyAblation", task, num_envs)
            steppers.append(stepper("NumPy, whole grid", whole))
        steppers.append(stepper("SyncVectorEnv", _sync(env_id, num_envs)))
    return steppers


def changed_px(task: str) -> float:
    """Mean number of pixels of the observation that a random pulse changes."""
    envs = gym.make_vec(f"lasergym/{task}-v0", num_envs=64)
    before, _ = envs.reset(seed=0)
    generator = np.random.default_rng(0)
    for _ in range(EPISODE_STEPS):
        after, *_ = envs.step(generator.uniform(-1, 1, (64, 2)).astype(np.float32))
    return float((before != after).sum()) / (64 * EPISODE_STEPS)


def shape_time_us(shapes: int = 20_000) -> float:
    """Time for one random shape of at least 3000 px, µs, the draws that are not kept included."""
    started_s = time.perf_counter()
    targets.random_shape_areas(0, shapes)
    return (time.perf_counter() - started_s) / shapes * 1e6


def _native(env_id: str, num_envs: int, threads: int, *, copy: bool) -> _Step:
    envs = gym.make_vec(env_id, num_envs=num_envs, threads=threads, copy=copy)
    envs.reset(seed=0)
    return envs.step


def _sync(env_id: str, num_envs: int) -> _Step:
    single = gym.make(env_id).unwrapped
    envs = SyncVectorEnv([type(single)] * num_envs, copy=False)
    envs.reset(seed=0)
    return envs.step


def _numpy(path: Path, name: str, task: str, num_envs: int) -> _Step:
    spec = importlib.util.spec_from_file_location("numpy_ablation", path)
    if spec is None or spec.loader is None:
        raise OptionError(f"{path} is no Python file")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    if not hasattr(module, name):
        raise OptionError(f"{path} has no class {name}")
    envs = getattr(module, name)(task, num_envs)
    envs.reset(seed=0)
    step: _Step = envs.step
    return step
