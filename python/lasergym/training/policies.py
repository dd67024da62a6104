"""The policy class of each kind of network and the arguments it takes."""

from __future__ import annotations

from typing import Any

import torch
from stable_baselines3.common.policies import ActorCriticCnnPolicy, ActorCriticPolicy

import lasergym.sb3
from lasergym.training.config import Activation, ConfigError, PolicyConfig, PolicyKind, TaskConfig

__all__ = ["policy_arguments", "policy_class"]

_ACTIVATIONS = {Activation.TANH: torch.nn.Tanh, Activation.RELU: torch.nn.ReLU}


def policy_class(kind: PolicyKind) -> type[ActorCriticPolicy]:
    """The class of a kind of network.

    Raises:
        ConfigError: This version has no such network.
    """
    if kind is PolicyKind.MLP:
        return ActorCriticPolicy
    if kind is PolicyKind.CNN:
        return ActorCriticCnnPolicy
    found: type[ActorCriticPolicy] | None = getattr(lasergym.sb3, "SpatialPolicy", None)
    if found is None:
        raise ConfigError(f'this version has no policy "{kind.value}": take "mlp" or "cnn"')
    return found


def policy_arguments(policy: PolicyConfig, task: TaskConfig) -> dict[str, Any]:
    """The keyword arguments of the policy class, those of the configuration last."""
    arguments: dict[str, Any] = {}
    if policy.kind is not PolicyKind.SPATIAL:
        arguments = {
            "net_arch": list(policy.hidden_layers),
            "activation_fn": _ACTIVATIONS[policy.activation],
            "log_std_init": policy.initial_log_std,
        }
    if task.normalise_observations:
        arguments["normalize_images"] = False
    return arguments | dict(policy.arguments)
