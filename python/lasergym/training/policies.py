"""The policy class of each kind of network and the arguments it takes."""

from __future__ import annotations

from typing import Any

import torch
from stable_baselines3.common.policies import ActorCriticCnnPolicy, ActorCriticPolicy

from lasergym.sb3 import SpatialPolicy
from lasergym.training.config import Activation, PolicyConfig, PolicyKind, TaskConfig

__all__ = ["policy_arguments", "policy_class"]

_ACTIVATIONS = {Activation.TANH: torch.nn.Tanh, Activation.RELU: torch.nn.ReLU}


def policy_class(kind: PolicyKind) -> type[ActorCriticPolicy]:
    """The class of a kind of network."""
    classes: dict[PolicyKind, type[ActorCriticPolicy]] = {
        PolicyKind.MLP: ActorCriticPolicy,
        PolicyKind.CNN: ActorCriticCnnPolicy,
        PolicyKind.SPATIAL: SpatialPolicy,
    }
    return classes[kind]


def policy_arguments(policy: PolicyConfig, task: TaskConfig) -> dict[str, Any]:
    """The keyword arguments of the policy class, those of the configuration last."""
    if policy.kind is PolicyKind.SPATIAL:
        process = {"max_pulses": task.max_pulses, "pulse_radius_px": task.pulse_radius_px}
        return process | dict(policy.arguments)
    arguments: dict[str, Any] = {
        "net_arch": list(policy.hidden_layers),
        "activation_fn": _ACTIVATIONS[policy.activation],
        "log_std_init": policy.initial_log_std,
    }
    if task.normalise_observations:
        arguments["normalize_images"] = False
    return arguments | dict(policy.arguments)
