"""Policies of Stable-Baselines3 as policy files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from os import PathLike
from typing import Any

import numpy as np
import torch
from torch import nn

from lasergym.errors import MissingExtraError
from lasergym.export.errors import ExportError
from lasergym.export.file import ExportResult, write_network
from lasergym.export.network import (
    ActionMapping,
    ExportablePolicy,
    ExportedNetwork,
    ObservationScaling,
    RunningNormalisation,
)
from lasergym.export.storage import StorageName
from lasergym.export.tracing import check_input_shape, trace_module

__all__ = ["export_policy"]


def export_policy(
    model_or_policy: Any,
    path: str | PathLike[str],
    *,
    environment: Any = None,
    training: Mapping[str, Any] | None = None,
    vec_normalize: Any = None,
    storage: StorageName = "float32",
    decision: Mapping[str, Any] | None = None,
) -> ExportResult:
    """Writes a trained policy as a file for the runner.

    Args:
        model_or_policy: An on-policy algorithm of Stable-Baselines3 (PPO, A2C) or its policy, with
            a feature extractor made of supported layers; or any policy with a method
            ``exported()``, see :class:`ExportablePolicy`.
        path: The file to write, usually ``*.safetensors``.
        environment: What it was trained in: an id, ``{"id": …, "arguments": …}`` or an
            environment with a ``spec``. Its ``max_pulses`` is what the runner counts pulses left
            in; without, 45.
        training: Summary of the training; JSON.
        vec_normalize: The ``VecNormalize`` that scaled the observations; taken from the model
            where it has one.
        storage: Type of the stored weights.
        decision: Overrides the decision of the policy; JSON.

    Returns:
        What was written.
    """
    described = _described_environment(environment)
    policy = getattr(model_or_policy, "policy", model_or_policy)
    if isinstance(policy, ExportablePolicy):
        network = policy.exported()
    else:
        if vec_normalize is None and hasattr(model_or_policy, "get_vec_normalize_env"):
            vec_normalize = model_or_policy.get_vec_normalize_env()
        network = _actor(policy, vec_normalize, described)
    if decision is not None:
        network = replace(network, decision=decision)
    return write_network(network, path, storage=storage, environment=described, training=training)


def _actor(
    policy: Any, vec_normalize: Any, environment: Mapping[str, Any] | None
) -> ExportedNetwork:
    """The network from observation to mean action of an on-policy actor."""
    try:
        from gymnasium import spaces
        from stable_baselines3.common.policies import ActorCriticPolicy
        from stable_baselines3.common.preprocessing import is_image_space
    except ImportError as error:
        raise MissingExtraError(
            'export_policy needs Stable-Baselines3: pip install "lasergym[train]"'
        ) from error
    if not isinstance(policy, ActorCriticPolicy):
        raise ExportError(
            f"{type(policy).__name__} is not supported: export the policy of PPO or A2C, or give "
            "it a method exported() that says its layers"
        )
    observations, actions = policy.observation_space, policy.action_space
    if not isinstance(observations, spaces.Box) or not isinstance(actions, spaces.Box):
        raise ExportError(
            f"observations {observations} and actions {actions} must both be a Box for the runner"
        )
    extractor = getattr(policy, "pi_features_extractor", policy.features_extractor)
    shape = check_input_shape(observations.shape)
    actor = nn.Sequential(extractor, policy.mlp_extractor.policy_net, policy.action_net)
    layers, tensors = trace_module(actor)
    image = policy.normalize_images and is_image_space(observations)
    arguments = (environment or {}).get("arguments") or {}
    scaling = ObservationScaling(
        name=str(arguments.get("observation", "")),
        divide_by=255.0 if image else 1.0,
        normalise=_running_normalisation(vec_normalize),
    )
    decision: dict[str, Any] = {"kind": "direct"}
    if "max_pulses" in arguments:
        decision["max_pulses"] = arguments["max_pulses"]
    return ExportedNetwork(
        shape, layers, tensors, scaling, _action_mapping(policy, actions), decision
    )


def _running_normalisation(vec_normalize: Any) -> RunningNormalisation | None:
    if vec_normalize is None or not vec_normalize.norm_obs:
        return None
    statistics = vec_normalize.obs_rms
    return RunningNormalisation(
        torch.as_tensor(np.asarray(statistics.mean)).flatten(),
        torch.as_tensor(np.asarray(statistics.var)).flatten(),
        float(vec_normalize.epsilon),
        float(vec_normalize.clip_obs),
    )


def _action_mapping(policy: Any, actions: Any) -> ActionMapping:
    limit = float(np.finfo(np.float32).max)
    low, high = (
        tuple(float(side) for side in np.clip(bound.astype(np.float64), -limit, limit).ravel())
        for bound in (actions.low, actions.high)
    )
    return ActionMapping("squash" if policy.squash_output else "clip", low, high)


def _described_environment(environment: Any) -> dict[str, Any] | None:
    """``id`` and ``arguments`` of an environment."""
    if environment is None:
        return None
    if isinstance(environment, str):
        return {"id": environment, "arguments": {}}
    if isinstance(environment, Mapping):
        return dict(environment)
    spec = getattr(environment, "spec", None)
    if spec is None and hasattr(environment, "get_attr"):
        spec = environment.get_attr("spec")[0]
    if spec is None:
        raise ExportError(
            f"{type(environment).__name__} has no spec: give the environment as its id or as "
            '{"id": ..., "arguments": ...}'
        )
    arguments = {key: value for key, value in spec.kwargs.items() if key != "target"}
    return {"id": spec.id, "arguments": arguments}
