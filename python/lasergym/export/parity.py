"""Torch and the runner on the same observations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from lasergym.export.errors import ParityError

__all__ = ["ParityReport", "parity_report"]

TOLERANCE = 1e-4
"""Largest difference that counts as equal, in units of the action."""

_BATCH = 64


@dataclass(frozen=True)
class ParityReport:
    """How far the runner is from torch.

    Attributes:
        path: The policy file.
        file_bytes: Its size, bytes.
        observations: Number of observations compared.
        largest_difference: Largest absolute difference of any output.
        mean_difference: Mean absolute difference of all outputs.
        tolerance: Largest difference that counts as equal.
    """

    path: Path
    file_bytes: int
    observations: int
    largest_difference: float
    mean_difference: float
    tolerance: float


def parity_report(
    policy: Any,
    path: str | PathLike[str],
    observations: NDArray[Any],
    runner: Callable[[NDArray[Any]], NDArray[np.floating[Any]]],
    *,
    vec_normalize: Any = None,
    tolerance: float = TOLERANCE,
) -> ParityReport:
    """Compares a policy in torch with the runner on its file.

    Args:
        policy: A model or policy of Stable-Baselines3, compared by its deterministic actions; or a
            module of torch, compared by its outputs.
        path: The policy file that the runner has loaded.
        observations: Observations, shape (n, …); 1000 are a good number.
        runner: Takes observations and gives actions (or outputs, for a module), shape (n, …).
        vec_normalize: The ``VecNormalize`` of the training; taken from the model where it has one.
        tolerance: Largest difference that counts as equal.

    Returns:
        The differences.

    Raises:
        ParityError: A difference is larger than ``tolerance`` or not a number.
    """
    if len(observations) == 0:
        raise ParityError("there is no observation to compare on: give some")
    if vec_normalize is None and hasattr(policy, "get_vec_normalize_env"):
        vec_normalize = policy.get_vec_normalize_env()
    largest, total, count = 0.0, 0.0, 0
    for start in range(0, len(observations), _BATCH):
        batch = observations[start : start + _BATCH]
        expected = _reference(policy, batch, vec_normalize)
        actual = np.asarray(runner(batch), np.float64).reshape(expected.shape)
        differences = np.abs(actual - expected)
        if not differences.max() <= tolerance:
            index = start + int(np.argmax(differences.reshape(len(batch), -1).max(1)))
            raise ParityError(
                f"torch and the runner differ by {differences.max():.3g} at observation {index}, "
                f"more than {tolerance:g}: {path} is not this policy, or export it as float32"
            )
        largest = max(largest, float(differences.max()))
        total += float(differences.sum())
        count += differences.size
    path = Path(path)
    return ParityReport(
        path, path.stat().st_size, len(observations), largest, total / count, tolerance
    )


def _reference(policy: Any, batch: NDArray[Any], vec_normalize: Any) -> NDArray[np.float64]:
    """What torch gives on a batch."""
    if hasattr(policy, "predict"):
        if vec_normalize is not None:
            batch = vec_normalize.normalize_obs(batch)
        actions, _ = policy.predict(batch, deterministic=True)
        return np.asarray(actions, np.float64)
    policy.eval()
    with torch.no_grad():
        outputs = policy(torch.as_tensor(np.asarray(batch, np.float32)))
    return np.asarray(outputs.numpy(), np.float64)
