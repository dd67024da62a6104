"""Checkpoints that are whole or not there: what a killed run goes on from."""

from __future__ import annotations

import json
import os
import pickle
import random
import re
import shutil
import zipfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.save_util import load_from_zip_file
from stable_baselines3.common.vec_env import VecNormalize

from lasergym.errors import LasergymError
from lasergym.sb3 import SelfImitation

__all__ = [
    "CONFIG_FILE",
    "MODEL_FILE",
    "NORMALISER_FILE",
    "CheckpointError",
    "RunState",
    "latest_checkpoint",
    "latest_model",
    "load_checkpoint",
    "load_normaliser",
    "read_state",
    "save_checkpoint",
    "write_whole",
]

CONFIG_FILE = "config.json"
MODEL_FILE = "model.zip"
NORMALISER_FILE = "vec_normalize.pkl"
_STATE_FILE = "state.json"
_MEMORY_FILE = "self_imitation.npz"
_FOLDER = "checkpoints"
_NAME = re.compile(r"step-(\d{12,})")
_DAMAGES = (
    OSError,
    EOFError,
    RuntimeError,
    ValueError,
    KeyError,
    TypeError,
    AttributeError,
    pickle.UnpicklingError,
    zipfile.BadZipFile,
)
"""What reading a damaged file raises."""


class CheckpointError(LasergymError, ValueError):
    """A checkpoint is missing or damaged."""


@dataclass(frozen=True)
class RunState:
    """How far a run is.

    Attributes:
        steps: Pulses trained with.
        updates: Updates of the algorithm, as Stable-Baselines3 counts them.
        training_s: Time of training, evaluations and checkpoints left out, s.
        environment_s: Part of it in the environments, s.
        evaluated_steps: Steps at the last evaluation.
    """

    steps: int
    updates: int
    training_s: float
    environment_s: float
    evaluated_steps: int


def save_checkpoint(
    folder: Path,
    model: OnPolicyAlgorithm,
    state: RunState,
    imitation: SelfImitation | None,
    kept: int,
) -> Path:
    """Writes a checkpoint: weights, optimiser, normaliser, memory, random streams and state.

    It is written beside and renamed when it has reached the disk, so that a process that is killed
    at any moment leaves the one before it.

    Args:
        folder: Folder of the run.
        model: What is trained.
        state: How far it is.
        imitation: Its self-imitation, whose memory is kept too.
        kept: How many checkpoints stay; older ones are deleted.

    Returns:
        The folder of the checkpoint; where there is one of so many steps already, that.
    """
    checkpoints = folder / _FOLDER
    final = checkpoints / f"step-{state.steps:012d}"
    if final.exists():
        return final
    scratch = checkpoints / f".{final.name}.{os.getpid()}"
    shutil.rmtree(scratch, ignore_errors=True)
    scratch.mkdir(parents=True)
    model.save(scratch / MODEL_FILE)
    normaliser = model.get_vec_normalize_env()
    if normaliser is not None:
        normaliser.save(str(scratch / NORMALISER_FILE))
    if imitation is not None:
        imitation.save(scratch / _MEMORY_FILE)
    written = json.dumps({**asdict(state), "random": _random_state()})
    (scratch / _STATE_FILE).write_text(written + "\n", encoding="utf-8")
    for file in scratch.iterdir():
        _sync(file)
    scratch.rename(final)
    _sync(checkpoints)
    for old in _found(folder)[:-kept]:
        shutil.rmtree(old, ignore_errors=True)
    for torn in checkpoints.glob(".step-*"):
        shutil.rmtree(torn, ignore_errors=True)
    return final


def latest_checkpoint(folder: Path) -> Path:
    """The checkpoint with the most steps.

    Raises:
        CheckpointError: There is none.
    """
    found = _found(folder)
    if not found:
        raise CheckpointError(f"{folder} holds no checkpoint: delete it and start the run anew")
    return found[-1]


def latest_model(folder: Path) -> Path | None:
    """The model of a finished run, or that of its latest checkpoint; None before the first."""
    if (folder / MODEL_FILE).exists():
        return folder / MODEL_FILE
    found = _found(folder)
    return found[-1] / MODEL_FILE if found else None


def read_state(checkpoint: Path) -> RunState:
    """How far a run was.

    Raises:
        CheckpointError: The checkpoint is damaged.
    """
    table = _read(checkpoint)
    try:
        return RunState(**{name: table[name] for name in RunState.__dataclass_fields__})
    except KeyError as error:
        raise CheckpointError(f"{checkpoint} is damaged: {error} is missing") from error


def load_normaliser(checkpoint: Path, venv: Any) -> VecNormalize:
    """The normaliser of a checkpoint, round the environments ``venv``.

    Raises:
        CheckpointError: It is missing or damaged.
    """
    path = checkpoint / NORMALISER_FILE
    if not path.exists():
        raise CheckpointError(f"{checkpoint} is damaged: {NORMALISER_FILE} is missing")
    try:
        return VecNormalize.load(str(path), venv)
    except _DAMAGES as error:
        raise CheckpointError(f"{path} cannot be loaded: {error}") from error


def load_checkpoint(
    checkpoint: Path, model: OnPolicyAlgorithm, imitation: SelfImitation | None
) -> None:
    """Brings a freshly made model, its self-imitation and all random streams to a checkpoint.

    The environments begin new episodes. Only weights are read from the model's file.

    Raises:
        CheckpointError: The checkpoint is damaged or of another configuration.
    """
    try:
        state = read_state(checkpoint)
        _, parameters, _ = load_from_zip_file(
            checkpoint / MODEL_FILE, device=model.device, load_data=False
        )
        model.set_parameters(parameters, exact_match=True, device=model.device)
        model.num_timesteps = state.steps
        model._n_updates = state.updates
        if imitation is not None:
            imitation.load(checkpoint / _MEMORY_FILE)
        _set_random_state(_read(checkpoint)["random"])
    except CheckpointError:
        raise
    except _DAMAGES as error:
        raise CheckpointError(f"{checkpoint} cannot be loaded: {error}") from error


def write_whole(path: Path, text: str) -> None:
    """Writes a file so that it is either old or new, never torn."""
    scratch = path.with_name(f".{path.name}.{os.getpid()}")
    scratch.write_text(text, encoding="utf-8")
    _sync(scratch)
    scratch.replace(path)


def _found(folder: Path) -> list[Path]:
    """The whole checkpoints, the oldest first."""
    checkpoints = folder / _FOLDER
    if not checkpoints.is_dir():
        return []
    named = [(_NAME.fullmatch(path.name), path) for path in checkpoints.iterdir()]
    return [path for _, path in sorted((int(name[1]), path) for name, path in named if name)]


def _read(checkpoint: Path) -> dict[str, Any]:
    try:
        table = json.loads((checkpoint / _STATE_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise CheckpointError(f"{checkpoint} is damaged: {error}") from error
    if not isinstance(table, dict):
        raise CheckpointError(f"{checkpoint} is damaged: {_STATE_FILE} holds no table")
    return table


def _random_state() -> dict[str, Any]:
    """The global streams of Python, NumPy and torch, which Stable-Baselines3 draws from."""
    python_version, python_words, python_gauss = random.getstate()
    numpy_state: Any = np.random.get_state(legacy=False)  # noqa: NPY002 - what SB3 draws from
    return {
        "python": [python_version, list(python_words), python_gauss],
        "numpy": {
            **{name: numpy_state[name] for name in ("bit_generator", "has_gauss", "gauss")},
            "key": numpy_state["state"]["key"].tolist(),
            "pos": numpy_state["state"]["pos"],
        },
        "torch": torch.get_rng_state().numpy().tobytes().hex(),
        "cuda": [one.numpy().tobytes().hex() for one in _cuda_states()],
    }


def _set_random_state(state: Mapping[str, Any]) -> None:
    version, words, gauss = state["python"]
    random.setstate((version, tuple(words), gauss))
    kept = state["numpy"]
    key = np.array(kept["key"], np.uint32)
    np.random.set_state(  # noqa: NPY002 - what SB3 draws from
        {
            "bit_generator": kept["bit_generator"],
            "state": {"key": key, "pos": kept["pos"]},
            "has_gauss": kept["has_gauss"],
            "gauss": kept["gauss"],
        }
    )
    torch.set_rng_state(_bytes_tensor(state["torch"]))
    if torch.cuda.is_available() and state["cuda"]:
        torch.cuda.set_rng_state_all([_bytes_tensor(one) for one in state["cuda"]])


def _cuda_states() -> list[torch.Tensor]:
    return torch.cuda.get_rng_state_all() if torch.cuda.is_available() else []


def _bytes_tensor(text: str) -> torch.Tensor:
    return torch.frombuffer(bytearray.fromhex(text), dtype=torch.uint8)


def _sync(path: Path) -> None:
    """Waits until a file or folder has reached the disk."""
    try:
        descriptor = os.open(path, os.O_RDONLY)
    except PermissionError:  # Windows does not open folders.
        return
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
