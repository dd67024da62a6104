"""Networks as the runner knows them: layers by name, tensors, scaling, actions, decision."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import torch

__all__ = [
    "ActionMapping",
    "ExportablePolicy",
    "ExportedLayer",
    "ExportedNetwork",
    "ObservationScaling",
    "RunningNormalisation",
]


@dataclass(frozen=True)
class ExportedLayer:
    """One layer of a network.

    Attributes:
        name: A name of its own, not ``"input"``.
        kind: What it does, for instance ``"conv2d"``; the names of ``Operation`` in the crate.
        settings: Settings of that kind, tensors by their names in the file.
        inputs: Names of what it reads; empty for the layer just before.
    """

    name: str
    kind: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    inputs: tuple[str, ...] = ()

    def manifest(self) -> dict[str, Any]:
        """The layer as the manifest has it."""
        entry: dict[str, Any] = {"name": self.name}
        if self.inputs:
            entry["inputs"] = list(self.inputs)
        return entry | {"operation": {"kind": self.kind, **self.settings}}


@dataclass(frozen=True)
class RunningNormalisation:
    """clip((x − mean) / √(variance + epsilon), −clip, clip), as ``VecNormalize`` does it.

    Attributes:
        mean: One value a value of the observation.
        variance: One value a value of the observation.
        epsilon: Added to the variance.
        clip: Largest magnitude of the result.
    """

    mean: torch.Tensor
    variance: torch.Tensor
    epsilon: float
    clip: float


@dataclass(frozen=True)
class ObservationScaling:
    """How an observation becomes the input of the first layer.

    Attributes:
        name: Name of the kind of observation, for instance ``"layers"``.
        divide_by: Divisor, applied last; 255 for images of bytes.
        normalise: Running normalisation, applied first.
    """

    name: str = ""
    divide_by: float = 1.0
    normalise: RunningNormalisation | None = None


@dataclass(frozen=True)
class ActionMapping:
    """How the output of the network becomes an action.

    Attributes:
        kind: ``"identity"``, ``"clip"`` (to the range) or ``"squash"`` (by tanh into the range).
        low: Least value of each action.
        high: Greatest value of each action.
    """

    kind: str = "identity"
    low: tuple[float, ...] = ()
    high: tuple[float, ...] = ()

    def manifest(self) -> dict[str, Any]:
        """The mapping as the manifest has it."""
        if self.kind == "identity":
            return {"kind": self.kind}
        return {"kind": self.kind, "low": list(self.low), "high": list(self.high)}


@dataclass(frozen=True)
class ExportedNetwork:
    """Everything about a policy that a file holds, before it is written.

    Attributes:
        input_shape: Channels, height and width of the observation.
        layers: The layers in the order in which they run; the last one gives the output.
        tensors: Tensors that the layers name.
        observation: Scaling of the observation.
        actions: From the output to the action.
        decision: How the caller turns the output into a decision; free JSON.
    """

    input_shape: tuple[int, int, int]
    layers: tuple[ExportedLayer, ...]
    tensors: Mapping[str, torch.Tensor]
    observation: ObservationScaling = field(default_factory=ObservationScaling)
    actions: ActionMapping = field(default_factory=ActionMapping)
    decision: Mapping[str, Any] = field(default_factory=lambda: {"kind": "direct"})


@runtime_checkable
class ExportablePolicy(Protocol):
    """A policy that says its own layers and decision."""

    def exported(self) -> ExportedNetwork:
        """The network that decides, with its decision."""
