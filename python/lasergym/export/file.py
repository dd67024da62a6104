"""Policy files: safetensors with a manifest."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from os import PathLike
from pathlib import Path
from typing import Any

from safetensors.torch import save
from torch import nn

from lasergym.export.errors import ExportError
from lasergym.export.network import ActionMapping, ExportedNetwork, ObservationScaling
from lasergym.export.storage import StorageName, stored_tensors
from lasergym.export.tracing import check_input_shape, trace_module

__all__ = ["ExportResult", "export_module", "network_bytes", "write_network"]

FORMAT = 1
"""Version of the manifest."""

_MEAN, _VARIANCE = "observation.mean", "observation.variance"


@dataclass(frozen=True)
class ExportResult:
    """A policy file that was written.

    Attributes:
        path: The file.
        file_bytes: Its size, bytes.
        layers: Number of layers.
        parameters: Number of weights and biases.
        storage: Type of the stored weights.
    """

    path: Path
    file_bytes: int
    layers: int
    parameters: int
    storage: StorageName


def write_network(
    network: ExportedNetwork,
    path: str | PathLike[str],
    *,
    storage: StorageName = "float32",
    environment: Mapping[str, Any] | None = None,
    training: Mapping[str, Any] | None = None,
) -> ExportResult:
    """Writes a network as a policy file.

    Args:
        network: The network.
        path: The file to write, usually ``*.safetensors``.
        storage: Type of the stored weights, see :func:`stored_tensors`.
        environment: ``id`` and ``arguments`` of the environment; JSON.
        training: Summary of the training; JSON.

    Returns:
        What was written.
    """
    content = network_bytes(network, storage=storage, environment=environment, training=training)
    path = Path(path)
    path.write_bytes(content)
    parameters = sum(tensor.numel() for tensor in network.tensors.values())
    return ExportResult(path, len(content), len(network.layers), parameters, storage)


def network_bytes(
    network: ExportedNetwork,
    *,
    storage: StorageName = "float32",
    environment: Mapping[str, Any] | None = None,
    training: Mapping[str, Any] | None = None,
) -> bytes:
    """Content of the policy file of a network; the arguments are those of :func:`write_network`."""
    tensors = stored_tensors(network.layers, network.tensors, storage)
    observation: dict[str, Any] = {
        "name": network.observation.name,
        "divide_by": network.observation.divide_by,
    }
    normalise = network.observation.normalise
    if normalise is not None:
        running = {_MEAN: normalise.mean, _VARIANCE: normalise.variance}
        tensors |= stored_tensors((), running, "float32")
        observation["normalise"] = {
            "mean": _MEAN,
            "variance": _VARIANCE,
            "epsilon": normalise.epsilon,
            "clip": normalise.clip,
        }
    channels, height, width = network.input_shape
    manifest = {
        "format": FORMAT,
        "input": {"channels": channels, "height": height, "width": width},
        "layers": [layer.manifest() for layer in network.layers],
        "observation": observation,
        "actions": network.actions.manifest(),
        "decision": dict(network.decision),
        "environment": None if environment is None else dict(environment),
        "versions": _versions(),
        "training": None if training is None else dict(training),
    }
    try:
        text = json.dumps(manifest, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise ExportError(
            f"decision, environment and training must be plain JSON ({error})"
        ) from error
    return save(tensors, metadata={"lasergym": text})


def export_module(
    module: nn.Module,
    path: str | PathLike[str],
    input_shape: tuple[int, ...],
    storage: StorageName = "float32",
    decision: Mapping[str, Any] | None = None,
    *,
    observation: ObservationScaling | None = None,
    actions: ActionMapping | None = None,
    environment: Mapping[str, Any] | None = None,
    training: Mapping[str, Any] | None = None,
) -> ExportResult:
    """Writes a module of torch as a policy file.

    Args:
        module: A module made of supported layers, see :func:`trace_module`.
        path: The file to write.
        input_shape: Shape of one observation, without the batch.
        storage: Type of the stored weights.
        decision: How the caller turns the output into a decision; ``{"kind": "direct"}`` when None.
        observation: Scaling of the observation; none when None.
        actions: From the output to the action; the output itself when None.
        environment: ``id`` and ``arguments`` of the environment; JSON.
        training: Summary of the training; JSON.

    Returns:
        What was written.
    """
    shape = check_input_shape(input_shape)
    layers, tensors = trace_module(module)
    network = ExportedNetwork(
        shape,
        layers,
        tensors,
        observation or ObservationScaling(),
        actions or ActionMapping(),
        decision or {"kind": "direct"},
    )
    return write_network(network, path, storage=storage, environment=environment, training=training)


def _versions() -> dict[str, str]:
    versions = {name: _version(name) or "" for name in ("lasergym", "torch", "stable-baselines3")}
    versions["python"] = platform.python_version()
    return {name: number for name, number in versions.items() if number}


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None
