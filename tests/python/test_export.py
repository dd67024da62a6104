"""Policy files hold what torch computes: the layers, interpreted anew, give the same outputs."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("torch")
pytest.importorskip("safetensors")
pytest.importorskip("stable_baselines3")

import gymnasium as gym
import torch
from safetensors import safe_open
from stable_baselines3 import A2C, PPO, SAC
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize
from torch import nn
from torch.nn import functional

import lasergym
from lasergym.errors import LasergymError
from lasergym.export import (
    ActionMapping,
    ExportablePolicy,
    ExportedNetwork,
    ExportError,
    ObservationScaling,
    ParityError,
    UnsupportedLayerError,
    export_module,
    export_policy,
    parity_report,
    trace_module,
)


class File:
    """A policy file, run by torch layer by layer as its manifest says."""

    def __init__(self, path: Path) -> None:
        with safe_open(path, "pt") as file:
            self.manifest = json.loads(file.metadata()["lasergym"])
            self.stored = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118

    def tensor(self, name: str | None, axis: int = 0) -> torch.Tensor | None:
        if name is None:
            return None
        tensor = self.stored[name]
        if tensor.dtype != torch.int8:
            return tensor.to(torch.float32)
        shape = [-1 if other == axis else 1 for other in range(tensor.ndim)]
        return tensor.to(torch.float32) * self.stored[f"{name}.scale"].reshape(shape)

    def outputs(self, observations: NDArray[Any]) -> torch.Tensor:
        entry = self.manifest["input"]
        shape = (-1, entry["channels"], entry["height"], entry["width"])
        x = torch.as_tensor(observations.astype(np.float32)).reshape(shape)
        scaling = self.manifest["observation"]
        if "normalise" in scaling:
            running = scaling["normalise"]
            mean, variance = self.stored[running["mean"]], self.stored[running["variance"]]
            deviation = torch.sqrt(variance + running["epsilon"]).reshape(shape[1:])
            x = (x - mean.reshape(shape[1:])) / deviation
            x = x.clamp(-running["clip"], running["clip"])
        results = {"input": x / scaling["divide_by"]}
        name = "input"
        for layer in self.manifest["layers"]:
            inputs = [results[source] for source in layer.get("inputs", [name])]
            name = layer["name"]
            results[name] = self.layer(dict(layer["operation"]), inputs)
        return results[name]

    def layer(self, settings: dict[str, Any], inputs: list[torch.Tensor]) -> torch.Tensor:
        kind = settings.pop("kind")
        x = inputs[0]
        if kind in ("conv2d", "conv_transpose2d", "linear"):
            axis = 1 if kind == "conv_transpose2d" else 0
            weight = self.tensor(settings.pop("weight"), axis)
            bias = self.tensor(settings.pop("bias", None))
            assert weight is not None
            if kind == "linear":
                result = functional.linear(x.flatten(1), weight, bias)
                return result[:, :, None, None]
            return getattr(functional, kind)(x, weight, bias, **settings)  # type: ignore[no-any-return]
        if kind == "normalise":
            mean, deviation = self.tensor(settings["mean"]), self.tensor(settings["deviation"])
            assert mean is not None
            assert deviation is not None
            return (x - mean[:, None, None]) / deviation[:, None, None]
        simple: dict[str, Any] = {
            "flatten": lambda: x.flatten(1)[:, :, None, None],
            "relu": lambda: torch.relu(x),
            "leaky_relu": lambda: functional.leaky_relu(x, settings["slope"]),
            "elu": lambda: functional.elu(x, settings["alpha"]),
            "gelu": lambda: functional.gelu(x, approximate=settings["approximation"]),
            "silu": lambda: functional.silu(x),
            "tanh": lambda: torch.tanh(x),
            "sigmoid": lambda: torch.sigmoid(x),
            "max_pool": lambda: functional.max_pool2d(
                x, settings["kernel"], settings["stride"], settings["padding"]
            ),
            "avg_pool": lambda: functional.avg_pool2d(
                x,
                settings["kernel"],
                settings["stride"],
                settings["padding"],
                count_include_pad=settings["count_padding"],
            ),
            "global_average_pool": lambda: x.mean((2, 3), keepdim=True),
            "pixel_shuffle": lambda: functional.pixel_shuffle(x, settings["factor"]),
            "pixel_unshuffle": lambda: functional.pixel_unshuffle(x, settings["factor"]),
            "add": lambda: sum(inputs[1:], inputs[0]),
            "concat": lambda: torch.cat(inputs, 1),
        }
        return simple[kind]()  # type: ignore[no-any-return]

    def actions(self, observations: NDArray[Any]) -> NDArray[Any]:
        mapping = self.manifest["actions"]
        outputs: NDArray[Any] = self.outputs(observations).flatten(1).numpy()
        if mapping["kind"] == "identity":
            return outputs
        low, high = np.float32(mapping["low"]), np.float32(mapping["high"])
        if mapping["kind"] == "clip":
            return outputs.clip(low, high)
        squashed: NDArray[Any] = low + 0.5 * (np.tanh(outputs) + 1) * (high - low)
        return squashed


class Block(nn.Module):
    """A residual block as users write them."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(channels, channels, 3, padding="same", dilation=2)
        self.second = nn.Conv2d(channels, channels, 1, bias=False)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        y = functional.silu(self.first(x))
        y = torch.add(self.second(y), x)
        return torch.cat((y, x), dim=1).relu()


class Extractor(BaseFeaturesExtractor):
    """A feature extractor of one's own."""

    def __init__(self, space: gym.spaces.Box) -> None:
        super().__init__(space, 12)
        self.body = nn.Sequential(
            nn.Conv2d(space.shape[0], 4, 8, 8), nn.GELU(), Block(4), nn.AvgPool2d(3)
        )
        self.head = nn.Linear(8 * 4 * 4, 12)

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        return torch.tanh(self.head(torch.flatten(self.body(observations), 1)))


def images(count: int, channels: int = 1) -> NDArray[np.uint8]:
    generator = np.random.default_rng(7)
    return generator.integers(0, 256, (count, channels, 100, 100), np.uint8)


@pytest.mark.parametrize(
    ("algorithm", "policy", "settings"),
    [
        (PPO, "CnnPolicy", {}),
        (A2C, "MlpPolicy", {}),
        (PPO, "MlpPolicy", {"policy_kwargs": {"net_arch": {"pi": [9], "vf": [5]}}}),
        (
            PPO,
            "CnnPolicy",
            {"policy_kwargs": {"features_extractor_class": Extractor, "net_arch": [8]}},
        ),
        (
            PPO,
            "CnnPolicy",
            {"use_sde": True, "policy_kwargs": {"squash_output": True, "net_arch": [8]}},
        ),
    ],
    ids=["nature", "flatten", "two heads", "own extractor", "squashed"],
)
def test_policies_of_stable_baselines_survive_export(
    algorithm: Any, policy: str, settings: dict[str, Any], tmp_path: Path
) -> None:
    environment = lasergym.sb3.make_vec_env("lasergym/Star-v0", 2, observation="layers")
    if algorithm is PPO:
        settings = {"batch_size": 8, **settings}
    model = algorithm(policy, environment, seed=3, n_steps=4, **settings)
    with torch.no_grad():
        model.policy.action_net.weight.mul_(100)
    path = tmp_path / "policy.safetensors"
    arguments = {"observation": "layers", "max_pulses": 30}
    result = export_policy(
        model,
        path,
        environment={"id": "lasergym/Star-v0", "arguments": arguments},
        training={"timesteps": 0},
    )
    assert result.path == path
    assert result.file_bytes == path.stat().st_size
    file = File(path)
    report = parity_report(model, path, images(40, 3), file.actions)
    assert report.observations == 40
    assert report.largest_difference < 1e-5
    assert file.manifest["observation"] == {"name": "layers", "divide_by": 255.0}
    assert file.manifest["environment"]["arguments"] == arguments
    assert file.manifest["decision"] == {"kind": "direct", "max_pulses": 30}
    assert file.manifest["training"] == {"timesteps": 0}


def test_running_normalisation_is_exported(tmp_path: Path) -> None:
    environment = VecNormalize(
        DummyVecEnv([lambda: gym.make("Pendulum-v1")]), clip_obs=1.5, norm_reward=False
    )
    model = PPO("MlpPolicy", environment, n_steps=64, batch_size=32, seed=0)
    model.learn(128)
    path = tmp_path / "policy.safetensors"
    export_policy(model, path, environment="Pendulum-v1")
    generator = np.random.default_rng(1)
    observations = generator.normal(0, 3, (200, 3)).astype(np.float32)
    file = File(path)
    assert parity_report(model, path, observations, file.actions).largest_difference < 1e-5
    assert file.manifest["observation"]["normalise"]["clip"] == 1.5
    assert file.manifest["environment"] == {"id": "Pendulum-v1", "arguments": {}}


def test_a_policy_may_say_its_own_layers(tmp_path: Path) -> None:
    class Spatial:
        def exported(self) -> ExportedNetwork:
            module = nn.Conv2d(2, 1, 3, padding=1)
            layers, tensors = trace_module(module)
            decision = {"kind": "spatial", "stride_px": 2}
            return ExportedNetwork((2, 8, 8), layers, tensors, decision=decision)

    assert isinstance(Spatial(), ExportablePolicy)
    export_policy(Spatial(), tmp_path / "policy.safetensors")
    manifest = File(tmp_path / "policy.safetensors").manifest
    assert manifest["decision"] == {"kind": "spatial", "stride_px": 2}
    assert manifest["actions"] == {"kind": "identity"}


@pytest.mark.parametrize(
    ("storage", "tolerance"),
    [("float32", 1e-6), ("float16", 2e-3), ("bfloat16", 2e-2), ("int8", 2e-2)],
)
def test_modules_survive_export_in_every_storage(
    storage: Any, tolerance: float, tmp_path: Path
) -> None:
    torch.manual_seed(1)
    module = nn.Sequential(
        nn.PixelUnshuffle(2),
        nn.Conv2d(8, 6, 3, padding=1),
        nn.BatchNorm2d(6),
        nn.LeakyReLU(0.1),
        Block(6),
        nn.Dropout(),
        nn.MaxPool2d(3, 1, 1),
        nn.ConvTranspose2d(12, 4, 2, 2, bias=False),
        nn.ELU(),
        nn.PixelShuffle(2),
    ).eval()
    path = tmp_path / "module.safetensors"
    export_module(module, path, (2, 8, 8), storage, observation=ObservationScaling(divide_by=2.0))
    inputs = np.random.default_rng(0).uniform(-1, 1, (5, 2, 8, 8)).astype(np.float32)
    with torch.no_grad():
        expected = module(torch.as_tensor(inputs) / 2)
        actual = File(path).outputs(inputs)
    assert actual.shape == expected.shape
    assert (actual - expected).abs().max() < tolerance


def test_shorter_storage_gives_smaller_files(tmp_path: Path) -> None:
    module = nn.Linear(100, 200)
    sizes = [
        export_module(module, tmp_path / name, (100,), name).file_bytes  # type: ignore[arg-type]
        for name in ("float32", "bfloat16", "int8")
    ]
    assert sizes[0] > 1.8 * sizes[1] > 1.8 * 1.5 * sizes[2]


@pytest.mark.parametrize(
    ("module", "message"),
    [
        (nn.Sequential(nn.Conv2d(1, 2, 3), nn.GroupNorm(1, 2)), r"'0\.1' is a GroupNorm"),
        (nn.Conv2d(1, 2, 3, padding=1, padding_mode="circular"), "padding_mode"),
        (nn.ConvTranspose2d(2, 2, 3, groups=2), "groups"),
        (nn.MaxPool2d(2, ceil_mode=True), "ceil_mode"),
        (nn.AvgPool2d(2, ceil_mode=True), "ceil_mode"),
        (nn.AvgPool2d(2, divisor_override=3), "divisor_override"),
        (nn.AdaptiveAvgPool2d(3), "output size"),
        (nn.Flatten(0), "dimension 1"),
        (nn.Sequential(nn.Conv2d(1, 2, 2, padding="same")), "odd kernel"),
        (nn.BatchNorm2d(2, track_running_stats=False), "running statistics"),
    ],
)
def test_layers_that_the_runner_lacks_are_named(
    module: nn.Module, message: str, tmp_path: Path
) -> None:
    with pytest.raises(UnsupportedLayerError, match=message):
        export_module(nn.Sequential(module), tmp_path / "x.safetensors", (1, 8, 8))


class Applied(nn.Module):
    """Any function as a module."""

    def __init__(self, function: Any) -> None:
        super().__init__()
        self.function = function

    def forward(self, x: torch.Tensor) -> Any:
        return self.function(x)


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda x: x + 1, "only tensors"),
        (lambda x: torch.sin(x), "sin"),
        (lambda x: torch.cat([x, x], 2), "channels"),
        (lambda x: torch.flatten(x), "dimension 1"),
        (lambda x: x.relu() if x.sum() > 0 else x, "branch"),
        (lambda x: (x.relu(), x), "several outputs"),
        (lambda x: x, "last layer"),
    ],
)
def test_functions_that_the_runner_lacks_are_named(
    function: Any, message: str, tmp_path: Path
) -> None:
    with pytest.raises(UnsupportedLayerError, match=message):
        export_module(Applied(function), tmp_path / "x.safetensors", (1, 8, 8))


def test_what_cannot_be_exported_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.safetensors"
    module = nn.Linear(2, 2)
    with pytest.raises(ExportError, match="'float64'"):
        export_module(module, path, (2,), "float64")  # type: ignore[arg-type]
    with pytest.raises(ExportError, match="JSON"):
        export_module(module, path, (2,), decision={"kind": object()})
    with pytest.raises(ExportError, match="axes"):
        export_module(module, path, (2, 2, 2, 2))
    with pytest.raises(ExportError, match="SACPolicy"):
        export_policy(SAC("MlpPolicy", "Pendulum-v1"), path)
    with pytest.raises(ExportError, match="Box"):
        export_policy(PPO("MlpPolicy", "CartPole-v1"), path)
    with pytest.raises(ExportError, match="spec"):
        export_policy(PPO("MlpPolicy", "Pendulum-v1"), path, environment=object())
    with torch.no_grad():
        module.weight[0, 0] = float("nan")
    with pytest.raises(ExportError, match="not finite"):
        export_module(module, path, (2,))
    assert issubclass(ExportError, LasergymError)
    assert not path.exists()


def test_parity_fails_on_another_network(tmp_path: Path) -> None:
    module, path = nn.Linear(3, 2), tmp_path / "x.safetensors"
    export_module(module, path, (3,), actions=ActionMapping("clip", (-9, -9), (9, 9)))
    observations = np.random.default_rng(0).normal(size=(100, 3)).astype(np.float32)
    file = File(path)
    report = parity_report(module, path, observations, file.actions)
    assert report.file_bytes == path.stat().st_size
    with pytest.raises(ParityError, match=r"differ by 0\.5 at observation"):
        parity_report(module, path, observations, lambda batch: file.actions(batch) + 0.5)
    with pytest.raises(ParityError, match="differ by nan"):
        parity_report(module, path, observations, lambda batch: file.actions(batch) * np.nan)
    with pytest.raises(ParityError, match="no observation"):
        parity_report(module, path, observations[:0], file.actions)


def test_golden_files_are_those_of_their_script(golden: Path) -> None:
    for path in sorted((golden / "policy").glob("*.cases.safetensors")):
        with safe_open(path, "pt") as file:
            observations = file.get_tensor("observations").numpy()
            outputs = file.get_tensor("outputs")
        actual = File(path.with_name(path.name.replace(".cases", ""))).outputs(observations)
        assert (actual.reshape(outputs.shape) - outputs).abs().max() < 1e-5
