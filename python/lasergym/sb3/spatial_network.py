"""The network that corrects ring scores about the best place."""

from __future__ import annotations

from typing import TYPE_CHECKING

from torch import Tensor, nn
from torch.nn import functional

from lasergym.training.spatial_decision import (
    CORRECTION_REACH_PX,
    CORRECTION_WIDTH,
    POLISH_PX,
    RING_WEIGHT,
    VIEW_CHANNELS,
    VIEW_SIZE,
)

if TYPE_CHECKING:
    from lasergym.export import ExportedLayer, ExportedNetwork

__all__ = ["CORRECTION_REACH_PX", "CorrectionNet"]

_FIRST = 2
"""First row and column of the corrections among the 20 × 20 outputs, whose centre is at 10."""


class CorrectionNet(nn.Module):
    """Convolutions without padding from a view to corrections of the ring score.

    A stem and five residual convolutions take 28 × 28 to 10 × 10, every output sees 38 px of the
    view; four outputs each then are the corrections of 2 × 2 px. The last layer begins with zeros:
    untrained, it corrects nothing.
    """

    def __init__(self, channels: int = 32) -> None:
        """Makes the network.

        Args:
            channels: Width of all layers, at least 1.
        """
        super().__init__()
        self.channels = channels
        self.stem = nn.Conv2d(VIEW_CHANNELS, channels, 3)  # 28 → 26
        self.c1 = nn.Conv2d(channels, channels, 3, dilation=2)  # 22
        self.c2 = nn.Conv2d(channels, channels, 3, dilation=2)  # 18
        self.c3 = nn.Conv2d(channels, channels, 3, dilation=2)  # 14
        self.c4 = nn.Conv2d(channels, channels, 3)  # 12
        self.c5 = nn.Conv2d(channels, channels, 3)  # 10
        self.out = nn.Conv2d(channels, 4, 1)
        nn.init.zeros_(self.out.weight)
        if self.out.bias is not None:
            nn.init.zeros_(self.out.bias)

    def forward(self, views: Tensor) -> Tensor:
        """Corrections of views, see :meth:`corrections`."""
        return self.corrections(self.features(views))

    def features(self, views: Tensor) -> Tensor:
        """The last features of views (batch, 18, 28, 28), shape (batch, channels, 10, 10)."""
        features = functional.silu(self.stem(views))
        for layer in (self.c1, self.c2, self.c3, self.c4, self.c5):
            cut = layer.dilation[0]
            features = functional.silu(layer(features)) + features[..., cut:-cut, cut:-cut]
        return features

    def corrections(self, features: Tensor) -> Tensor:
        """Corrections at the offsets −8 to 8 of rows and columns, px; shape (batch, 17, 17)."""
        pixels = functional.pixel_shuffle(self.out(features), 2)[:, 0]
        end = _FIRST + CORRECTION_WIDTH
        return pixels[:, _FIRST:end, _FIRST:end]

    def exported(
        self, ring_weight: float = RING_WEIGHT, polish_px: float = POLISH_PX
    ) -> ExportedNetwork:
        """The network for the runner, which works out scores, view and position itself.

        Args:
            ring_weight: Weight of the ring in the scores that are corrected, in [0, 1].
            polish_px: Range of the polish, px, in [0, 2].
        """
        from lasergym.export import ExportedNetwork

        layers, tensors = self.exported_layers()
        decision = {"kind": "spatial", "ring_weight": ring_weight, "polish_px": polish_px}
        shape = (VIEW_CHANNELS, VIEW_SIZE, VIEW_SIZE)
        return ExportedNetwork(shape, layers, tensors, decision=decision)

    def exported_layers(self) -> tuple[tuple[ExportedLayer, ...], dict[str, Tensor]]:
        """The layers for the runner, and the tensors that they name."""
        from lasergym.export import ExportedLayer

        def convolution(name: str) -> ExportedLayer:
            layer = getattr(self, name)
            settings = {
                "weight": f"{name}.weight",
                "bias": f"{name}.bias",
                "dilation": list(layer.dilation),
            }
            return ExportedLayer(name, "conv2d", settings)

        def cut(before: int, behind: int) -> dict[str, int]:
            return {"top": before, "bottom": behind, "left": before, "right": behind}

        layers = [convolution("stem"), ExportedLayer("stem_silu", "silu")]
        features = "stem_silu"
        for name in ("c1", "c2", "c3", "c4", "c5"):
            margin = getattr(self, name).dilation[0]
            layers += [
                ExportedLayer(f"{name}_crop", "crop", cut(margin, margin), (features,)),
                ExportedLayer(name, "conv2d", convolution(name).settings, (features,)),
                ExportedLayer(f"{name}_silu", "silu"),
                ExportedLayer(f"{name}_add", "add", {}, (f"{name}_silu", f"{name}_crop")),
            ]
            features = f"{name}_add"
        layers += [
            convolution("out"),
            ExportedLayer("pixels", "pixel_shuffle", {"factor": 2}),
            ExportedLayer("corrections", "crop", cut(_FIRST, 20 - _FIRST - CORRECTION_WIDTH)),
        ]
        tensors = {name: tensor.detach() for name, tensor in self.state_dict().items()}
        return tuple(layers), tensors

    def load_exported(self, tensors: dict[str, Tensor]) -> None:
        """Takes the tensors of a policy file.

        Raises:
            KeyError: A tensor is missing.
            RuntimeError: A tensor has another shape.
        """
        taken = {}
        for name, own in self.state_dict().items():
            tensor = tensors[name].to(own.device, own.dtype)
            scale = tensors.get(f"{name}.scale")  # Of weights stored as bytes.
            if scale is not None:
                tensor = tensor * scale.to(own.device, own.dtype)[:, None, None, None]
            taken[name] = tensor
        self.load_state_dict(taken)
