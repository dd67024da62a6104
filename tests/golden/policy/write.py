"""Writes the golden files of this folder: `python tests/golden/policy/write.py`.

Each file holds a small seeded network of one family of layers. The file beside it,
`NAME.cases.safetensors`, has 16 observations and what torch gives on them. The tests of the crate
`policy` run the networks on the observations.
"""

from __future__ import annotations

import sys
from pathlib import Path

import torch
from safetensors.torch import save
from torch import nn

from lasergym.export import (
    ExportedNetwork,
    ObservationScaling,
    StorageName,
    trace_module,
    write_network,
)

CASES = 16


class Residual(nn.Module):
    """x + f(x), then both beside one another."""

    def __init__(self) -> None:
        """A dilated convolution over four channels."""
        super().__init__()
        self.convolution = nn.Conv2d(4, 4, 3, padding=2, dilation=2)
        self.activation = nn.SiLU()

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Eight channels."""
        y = x + self.activation(self.convolution(x))
        return torch.cat([y, torch.relu(x)], 1)


def families() -> dict[str, tuple[nn.Module, tuple[int, int, int], StorageName]]:
    """A network, the shape of its observation and the storage of its weights, by name."""
    activations = nn.Sequential(
        nn.Conv2d(2, 4, 1), nn.LeakyReLU(0.2), nn.Conv2d(4, 4, 1), nn.ELU(0.7), nn.Conv2d(4, 4, 1),
        nn.GELU(), nn.Conv2d(4, 4, 1), nn.GELU("tanh"), nn.Conv2d(4, 4, 1), nn.Sigmoid(),
    )  # fmt: skip
    norm = nn.BatchNorm2d(3)
    norm.running_mean, norm.running_var = torch.rand(3), torch.rand(3) + 0.5
    nn.init.uniform_(norm.weight, 0.5, 1.5)
    nn.init.uniform_(norm.bias)
    return {
        "convolution": (
            nn.Sequential(
                nn.Conv2d(2, 6, (3, 2), (2, 1), (1, 1)), nn.ReLU(), nn.Conv2d(6, 9, 3, groups=3)
            ),
            (2, 9, 7),
            "float32",
        ),
        "transposed": (
            nn.ConvTranspose2d(3, 5, 3, (2, 3), 1, (1, 2), dilation=(2, 1)),
            (3, 4, 3),
            "float32",
        ),
        "linear": (
            nn.Sequential(nn.Flatten(), nn.Linear(12, 20), nn.Tanh(), nn.Linear(20, 2)),
            (3, 2, 2),
            "float32",
        ),
        "activations": (activations, (2, 4, 4), "float32"),
        "pooling": (
            nn.Sequential(nn.MaxPool2d(3, 2, 1), nn.AvgPool2d(2, 1, 1), nn.AdaptiveAvgPool2d(1)),
            (3, 9, 8),
            "float32",
        ),
        "shuffle": (
            nn.Sequential(nn.PixelUnshuffle(2), nn.Conv2d(8, 18, 1), nn.PixelShuffle(3)),
            (2, 4, 6),
            "float32",
        ),
        "residual": (nn.Sequential(nn.Conv2d(2, 4, 1), Residual()), (2, 6, 6), "float32"),
        "normalise": (nn.Sequential(norm, nn.Conv2d(3, 2, 1)), (3, 4, 5), "float32"),
        "float16": (nn.Sequential(nn.Conv2d(2, 5, 3), nn.ReLU()), (2, 5, 5), "float16"),
        "bfloat16": (nn.Sequential(nn.Conv2d(2, 5, 3), nn.ReLU()), (2, 5, 5), "bfloat16"),
        "int8": (nn.Sequential(nn.Conv2d(2, 5, 3), nn.ConvTranspose2d(5, 3, 2)), (2, 5, 5), "int8"),
    }


def rounded(module: nn.Module, storage: StorageName) -> None:
    """Gives a module the weights that its file holds."""
    for layer in module.modules():
        if storage == "float32" or not isinstance(layer, nn.Conv2d | nn.ConvTranspose2d):
            continue
        weight = layer.weight.data
        if storage == "int8":
            axis = 1 if isinstance(layer, nn.ConvTranspose2d) else 0
            others = [other for other in range(4) if other != axis]
            scale = weight.abs().amax(others, keepdim=True) / 127
            layer.weight.data = torch.round(weight / scale) * scale
        else:
            layer.weight.data = weight.to(getattr(torch, storage)).to(torch.float32)


def write(folder: Path) -> None:
    """Writes every network and its cases."""
    torch.manual_seed(20)
    for name, (module, shape, storage) in families().items():
        module.eval()
        layers, tensors = trace_module(module)
        scaling = ObservationScaling("bytes", 255.0)
        network = ExportedNetwork(shape, layers, tensors, scaling)
        write_network(network, folder / f"{name}.safetensors", storage=storage)
        rounded(module, storage)
        observations = torch.randint(0, 256, (CASES, *shape)).to(torch.float32)
        with torch.no_grad():
            outputs = module(observations / 255)
        cases = {"observations": observations, "outputs": outputs.contiguous()}
        (folder / f"{name}.cases.safetensors").write_bytes(save(cases))


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
