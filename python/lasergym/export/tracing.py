"""From torch modules to layers of the runner."""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

import torch
from torch import fx, nn
from torch.nn import functional

from lasergym.export.errors import ExportError, UnsupportedLayerError
from lasergym.export.network import ExportedLayer

__all__ = ["trace_module"]

_Settings = dict[str, Any]

_FUNCTIONS: dict[Any, str] = {
    torch.relu: "relu",
    functional.relu: "relu",
    "relu": "relu",
    functional.silu: "silu",
    torch.tanh: "tanh",
    functional.tanh: "tanh",
    "tanh": "tanh",
    torch.sigmoid: "sigmoid",
    functional.sigmoid: "sigmoid",
    "sigmoid": "sigmoid",
}
"""Functions and methods of one argument."""

_ADDITIONS = {operator.add, operator.iadd, torch.add, "add", "add_"}
_FLATTENINGS = {torch.flatten, "flatten"}
_CONCATENATIONS = {torch.cat, torch.concat}
_NO_OPERATIONS = {"contiguous", "float"}


def trace_module(
    module: nn.Module,
) -> tuple[tuple[ExportedLayer, ...], dict[str, torch.Tensor]]:
    """Follows one input through a module in evaluation mode.

    Sequences, residual sums, concatenations and modules of one's own made of the supported layers
    are all understood.

    Args:
        module: A module that takes one tensor (batch, channels, height, width), or (batch,
            channels) where height and width are 1.

    Returns:
        The layers and the tensors that they name.
    """
    tracer = fx.Tracer()
    if tracer.is_leaf_module(module, ""):
        module = nn.Sequential(module)
    try:
        graph = tracer.trace(module)
    except Exception as error:
        raise UnsupportedLayerError(
            f"{type(module).__name__} cannot be followed from input to output ({error}): "
            "its forward must not branch on values"
        ) from error
    translation = _Translation(module)
    for node in graph.nodes:
        translation.add(node)
    return tuple(translation.layers), translation.tensors


class _Translation:
    """Layers and tensors so far, and what each node of the graph has become."""

    def __init__(self, module: nn.Module) -> None:
        self.module = module
        self.layers: list[ExportedLayer] = []
        self.tensors: dict[str, torch.Tensor] = {}
        self._sources: dict[fx.Node, str] = {}

    def add(self, node: fx.Node) -> None:
        """Translates one node."""
        if node.op == "placeholder":
            if self._sources:
                raise UnsupportedLayerError("the network has several inputs: export takes one")
            self._sources[node] = "input"
        elif node.op == "call_module":
            self._add_module(node, self.module.get_submodule(str(node.target)))
        elif node.op in ("call_function", "call_method"):
            self._add_function(node)
        elif node.op == "output":
            self._finish(node)
        else:
            raise UnsupportedLayerError(f"{node.target} is neither a layer nor a function")

    def _finish(self, node: fx.Node) -> None:
        result = node.args[0]
        if not isinstance(result, fx.Node):
            raise UnsupportedLayerError("the network has several outputs: export takes one")
        if not self.layers or self._sources[result] != self.layers[-1].name:
            raise UnsupportedLayerError("the last layer must give the output of the network")

    def _emit(self, node: fx.Node, kind: str, settings: _Settings, *inputs: Any) -> None:
        sources = tuple(self._sources[source] for source in inputs)
        previous = self.layers[-1].name if self.layers else "input"
        name = _unique(node.name, {"input", *(layer.name for layer in self.layers)})
        self._sources[node] = name
        self.layers.append(
            ExportedLayer(name, kind, settings, () if sources == (previous,) else sources)
        )

    def _add_module(self, node: fx.Node, module: nn.Module) -> None:
        (source,) = node.args
        if isinstance(module, nn.Identity | nn.Dropout | nn.Dropout2d):
            self._sources[node] = self._sources[_node(source)]
            return
        translate = _MODULES.get(type(module))
        if translate is None:
            supported = ", ".join(sorted(kind.__name__ for kind in _MODULES))
            raise UnsupportedLayerError(
                f"layer {node.target!r} is a {type(module).__name__}, which the runner does not "
                f"have: use {supported}"
            )
        kind, settings, tensors = translate(str(node.target), module)
        for role, tensor in tensors.items():
            name = f"{node.target}.{role}"
            self.tensors[name] = tensor
            settings[role] = name
        self._emit(node, kind, settings, source)

    def _add_function(self, node: fx.Node) -> None:
        target, arguments = node.target, node.args
        if target in _NO_OPERATIONS:
            self._sources[node] = self._sources[_node(arguments[0])]
        elif target in _FUNCTIONS:
            self._emit(node, _FUNCTIONS[target], {}, arguments[0])
        elif target in _ADDITIONS:
            if not all(isinstance(argument, fx.Node) for argument in arguments) or node.kwargs:
                raise UnsupportedLayerError(f"{node}: only tensors can be added")
            self._emit(node, "add", {}, *arguments)
        elif target in _CONCATENATIONS:
            parts: Any = arguments[0]
            dimension = arguments[1] if len(arguments) > 1 else node.kwargs.get("dim", 0)
            if dimension not in (1, -3):
                raise UnsupportedLayerError(f"{node}: only channels can be joined (dim=1)")
            self._emit(node, "concat", {}, *parts)
        elif target in _FLATTENINGS:
            start = arguments[1] if len(arguments) > 1 else node.kwargs.get("start_dim", 0)
            if start != 1 or len(arguments) > 2 or "end_dim" in node.kwargs:
                raise UnsupportedLayerError(f"{node}: flatten from dimension 1 to the last")
            self._emit(node, "flatten", {}, arguments[0])
        else:
            raise UnsupportedLayerError(
                f"the function {getattr(target, '__name__', target)} is not supported: use a "
                "module of torch.nn in its place"
            )


def _node(argument: Any) -> fx.Node:
    if not isinstance(argument, fx.Node):
        raise UnsupportedLayerError(f"{argument!r} is not the result of a layer")
    return argument


def _unique(name: str, taken: set[str]) -> str:
    candidate, number = name, 1
    while candidate in taken:
        number += 1
        candidate = f"{name}_{number}"
    return candidate


_Translated = tuple[str, _Settings, dict[str, torch.Tensor]]


def _pair(value: int | tuple[int, ...]) -> list[int]:
    return [value, value] if isinstance(value, int) else [int(side) for side in value]


def _weights(module: Any) -> dict[str, torch.Tensor]:
    if module.bias is None:
        return {"weight": module.weight}
    return {"weight": module.weight, "bias": module.bias}


def _conv2d(name: str, module: Any) -> _Translated:
    _require(name, module.padding_mode == "zeros", "padding_mode must be 'zeros'")
    kernel, dilation = _pair(module.kernel_size), _pair(module.dilation)
    if module.padding == "same":
        spans = [step * (side - 1) for step, side in zip(dilation, kernel, strict=True)]
        _require(name, all(span % 2 == 0 for span in spans), "'same' needs an odd kernel")
        padding = [span // 2 for span in spans]
    else:
        padding = [0, 0] if module.padding == "valid" else _pair(module.padding)
    settings = {
        "stride": _pair(module.stride),
        "padding": padding,
        "dilation": dilation,
        "groups": module.groups,
    }
    return "conv2d", settings, _weights(module)


def _conv_transpose2d(name: str, module: Any) -> _Translated:
    _require(name, module.groups == 1, "groups must be 1")
    settings = {
        "stride": _pair(module.stride),
        "padding": _pair(module.padding),
        "output_padding": _pair(module.output_padding),
        "dilation": _pair(module.dilation),
    }
    return "conv_transpose2d", settings, _weights(module)


def _linear(_name: str, module: Any) -> _Translated:
    return "linear", {}, _weights(module)


def _flatten(name: str, module: Any) -> _Translated:
    whole = module.start_dim == 1 and module.end_dim == -1
    _require(name, whole, "flatten from dimension 1 to the last")
    return "flatten", {}, {}


def _max_pool(name: str, module: Any) -> _Translated:
    _require(name, _pair(module.dilation) == [1, 1], "dilation must be 1")
    _require(name, not module.ceil_mode and not module.return_indices, "ceil_mode must be False")
    return "max_pool", _window(module), {}


def _avg_pool(name: str, module: Any) -> _Translated:
    _require(name, not module.ceil_mode, "ceil_mode must be False")
    _require(name, module.divisor_override is None, "divisor_override must be None")
    return "avg_pool", _window(module) | {"count_padding": module.count_include_pad}, {}


def _window(module: Any) -> _Settings:
    return {
        "kernel": _pair(module.kernel_size),
        "stride": _pair(module.stride),
        "padding": _pair(module.padding),
    }


def _global_average_pool(name: str, module: Any) -> _Translated:
    _require(name, module.output_size in (1, (1, 1)), "the output size must be 1")
    return "global_average_pool", {}, {}


def _batch_norm(name: str, module: Any) -> _Translated:
    """γ (x − μ) / √(σ² + ε) + β as (x − mean) / deviation."""
    _require(name, module.running_var is not None, "running statistics are needed")
    deviation = torch.sqrt(module.running_var.double() + module.eps)
    mean = module.running_mean.double()
    if module.affine:
        _require(name, bool((module.weight != 0).all()), "no weight may be 0")
        deviation = deviation / module.weight.double()
        mean = mean - module.bias.double() * deviation
    return "normalise", {}, {"mean": mean, "deviation": deviation}


def _require(name: str, condition: bool, expected: str) -> None:
    if not condition:
        raise UnsupportedLayerError(f"layer {name!r}: {expected} for the runner")


def _plain(kind: str, **settings: str) -> Callable[[str, Any], _Translated]:
    """A layer without weights whose settings are attributes of the module."""
    return lambda _name, module: (
        kind,
        {key: getattr(module, attribute) for key, attribute in settings.items()},
        {},
    )


_MODULES: dict[type[nn.Module], Callable[[str, Any], _Translated]] = {
    nn.Conv2d: _conv2d,
    nn.ConvTranspose2d: _conv_transpose2d,
    nn.Linear: _linear,
    nn.Flatten: _flatten,
    nn.ReLU: _plain("relu"),
    nn.LeakyReLU: _plain("leaky_relu", slope="negative_slope"),
    nn.ELU: _plain("elu", alpha="alpha"),
    nn.GELU: _plain("gelu", approximation="approximate"),
    nn.SiLU: _plain("silu"),
    nn.Tanh: _plain("tanh"),
    nn.Sigmoid: _plain("sigmoid"),
    nn.MaxPool2d: _max_pool,
    nn.AvgPool2d: _avg_pool,
    nn.AdaptiveAvgPool2d: _global_average_pool,
    nn.PixelShuffle: _plain("pixel_shuffle", factor="upscale_factor"),
    nn.PixelUnshuffle: _plain("pixel_unshuffle", factor="downscale_factor"),
    nn.BatchNorm1d: _batch_norm,
    nn.BatchNorm2d: _batch_norm,
}


def check_input_shape(shape: tuple[int, ...]) -> tuple[int, int, int]:
    """Channels, height and width of an observation of one, two or three axes."""
    if not 1 <= len(shape) <= 3 or any(side < 1 for side in shape):
        raise ExportError(f"observations of shape {shape} are not supported: use 1 to 3 axes")
    if len(shape) == 1:
        return shape[0], 1, 1
    if len(shape) == 2:
        return 1, shape[0], shape[1]
    return shape[0], shape[1], shape[2]
