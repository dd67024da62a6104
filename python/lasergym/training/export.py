"""A trained agent as a policy file, with the proof that the runner decides as torch does."""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from lasergym.envs import RandomShapeVectorEnv
from lasergym.errors import OptionError
from lasergym.export import (
    ExportResult,
    ParityReport,
    StorageName,
    export_policy,
    parity_report,
)
from lasergym.options import integer_in
from lasergym.policy import Policy
from lasergym.training.agents import Agent

__all__ = ["ExportedAgent", "export_agent", "visited_observations"]

_ROUNDED = {"float16": torch.float16, "bfloat16": torch.bfloat16}

_ENVIRONMENTS = 32
_EXPLORATION = 0.3
"""Share of random actions among those that lead to the observations compared."""


@dataclass(frozen=True)
class ExportedAgent:
    """A policy file and how far the runner on it is from torch.

    Attributes:
        file: What was written.
        parity: Differences of actions.
    """

    file: ExportResult
    parity: ParityReport


def export_agent(
    agent: Agent,
    path: Path,
    *,
    storage: StorageName = "float32",
    observations: int = 1000,
    seed: int = 0,
    training: dict[str, Any] | None = None,
) -> ExportedAgent:
    """Writes an agent for the runner and compares both on observations of random shapes.

    Args:
        agent: The agent.
        path: The file to write; it replaces another one only when torch and the runner agree.
        storage: Type of the stored weights: ``"float32"``, ``"float16"`` or ``"bfloat16"``. Torch
            is compared with the weights so rounded.
        observations: Observations that both act on, at least 1.
        seed: Seed of the observations.
        training: Summary of the training; JSON.

    Raises:
        OptionError: A figure is outside its range.
        ExportError: The agent has layers that the runner does not know.
        ParityError: Some action differs by more than 10⁻⁴; no file is left.
    """
    if storage != "float32" and storage not in _ROUNDED:
        raise OptionError(f"storage is {storage!r}, but must be float32, float16 or bfloat16")
    integer_in("observations", observations, 1, 1_000_000)
    max_pulses = 45 if agent.task is None else agent.task.max_pulses
    environment = None
    if agent.task is not None:
        environment = {"id": agent.task.env_id, "arguments": agent.task.process()}
    spatial = hasattr(agent.policy, "exported")
    decision = {"kind": "direct", "max_pulses": max_pulses, "thinning": agent.thinning}
    part = path.with_name(f"{path.name}.part")
    try:
        file = export_policy(
            agent.policy,
            part,
            environment=environment,
            vec_normalize=agent.normaliser,
            storage=storage,
            decision=None if spatial else decision,
            training=training,
        )
        runner = Policy.load(part)

        def run(batch: NDArray[np.uint8]) -> NDArray[np.float32]:
            return np.stack([runner.act(one, max_pulses=max_pulses) for one in batch])

        seen = visited_observations(agent, observations, max_pulses, seed)
        reference = _Reference(_as_stored(agent, storage), max_pulses)
        parity = replace(parity_report(reference, part, seen, run), path=path)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
    return ExportedAgent(replace(file, path=path), parity)


def visited_observations(
    agent: Agent, count: int, max_pulses: int, seed: int = 0
) -> NDArray[np.uint8]:
    """Observations of random shapes in every stage, as the agent meets them.

    Args:
        agent: The agent, which acts; three actions in ten are random instead.
        count: How many, at least 1.
        max_pulses: Pulse budget of the episodes.
        seed: Seed of shapes and actions.

    Returns:
        uint8, shape (count, channels, 100, 100).
    """
    venv = RandomShapeVectorEnv(
        num_envs=_ENVIRONMENTS, max_pulses=max_pulses, observation=agent.observation.value
    )
    generator = np.random.default_rng(seed)
    seen, _ = venv.reset(seed=seed)
    collected = []
    for _ in range(-(-count // _ENVIRONMENTS)):
        collected.append(seen.copy())
        actions = agent.act(seen, max_pulses)
        explores = generator.random(_ENVIRONMENTS) < _EXPLORATION
        actions[explores] = generator.uniform(-1, 1, (int(explores.sum()), 2))
        seen, *_ = venv.step(actions)
    venv.close()
    return np.concatenate(collected)[:count]


class _Reference:
    """An agent as :func:`lasergym.export.parity_report` asks policies."""

    def __init__(self, agent: Agent, max_pulses: int) -> None:
        self._agent, self._max_pulses = agent, max_pulses

    def predict(
        self, observations: NDArray[np.uint8], deterministic: bool
    ) -> tuple[NDArray[np.float32], None]:
        assert deterministic
        return self._agent.act(observations, self._max_pulses), None


def _as_stored(agent: Agent, storage: StorageName) -> Agent:
    """The agent with its weights rounded as they are in the file."""
    if storage == "float32":
        return agent
    policy = copy.deepcopy(agent.policy)
    with torch.no_grad():
        for weight in policy.parameters():
            if weight.ndim > 1:
                weight.copy_(weight.to(_ROUNDED[storage]))
    return replace(agent, policy=policy)
