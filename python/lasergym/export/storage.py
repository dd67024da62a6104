"""How weights are stored: as they are, shorter, or as bytes with a scale."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Literal, get_args

import torch

from lasergym.export.errors import ExportError
from lasergym.export.network import ExportedLayer

__all__ = ["StorageName", "stored_tensors"]

StorageName = Literal["float32", "float16", "bfloat16", "int8"]
"""Types of stored weights; biases and other vectors stay ``float32``."""

_OUTPUT_AXIS = {"conv2d": 0, "linear": 0, "conv_transpose2d": 1}
"""Axis of the output channels of a weight, by the kind of its layer."""


def stored_tensors(
    layers: Iterable[ExportedLayer], tensors: Mapping[str, torch.Tensor], storage: StorageName
) -> dict[str, torch.Tensor]:
    """Tensors as they go into the file.

    Args:
        layers: The layers that name the tensors.
        tensors: Tensors of any floating type.
        storage: Type of the weights of convolutions and linear layers. ``"int8"`` stores
            round(w / s) with s = max|w| / 127 of each output channel, and s as ``<name>.scale``.

    Returns:
        Contiguous tensors that share no memory.
    """
    if storage not in get_args(StorageName):
        accepted = ", ".join(map(repr, get_args(StorageName)))
        raise ExportError(f"storage is {storage!r}, but must be one of {accepted}")
    stored = {name: _float32(name, tensor) for name, tensor in tensors.items()}
    for layer in layers:
        axis = _OUTPUT_AXIS.get(layer.kind)
        name = layer.settings.get("weight")
        if axis is None or not isinstance(name, str) or stored[name].dtype != torch.float32:
            continue
        if storage == "float16":
            stored[name] = stored[name].to(torch.float16)
            if not torch.isfinite(stored[name]).all():
                raise ExportError(f"tensor {name!r} overflows as float16: store it as bfloat16")
        elif storage == "bfloat16":
            stored[name] = stored[name].to(torch.bfloat16)
        elif storage == "int8":
            stored[name], stored[f"{name}.scale"] = _quantised(stored[name], axis)
    return stored


def _float32(name: str, tensor: torch.Tensor) -> torch.Tensor:
    copy = tensor.detach().to("cpu", torch.float32).clone().contiguous()
    if not torch.isfinite(copy).all():
        raise ExportError(f"tensor {name!r} has values that are not finite: the training diverged")
    return copy


def _quantised(weight: torch.Tensor, axis: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Bytes, and one scale an output channel."""
    others = [other for other in range(weight.ndim) if other != axis]
    scale = weight.abs().amax(others) / 127
    scale = torch.where(scale > 0, scale, torch.ones_like(scale))
    shape = [-1 if other == axis else 1 for other in range(weight.ndim)]
    return torch.round(weight / scale.reshape(shape)).to(torch.int8), scale
