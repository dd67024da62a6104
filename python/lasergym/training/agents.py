"""A trained agent as it acts without exploration, read from a run or a model."""

from __future__ import annotations

import pickle
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.torch import load_file
from stable_baselines3.common.policies import ActorCriticPolicy, BasePolicy
from stable_baselines3.common.save_util import load_from_zip_file
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from lasergym.envs.settings import CHANNELS
from lasergym.errors import LasergymError
from lasergym.sb3 import SpatialPolicy, thinned
from lasergym.targets import SIZE_PX
from lasergym.training.checkpoints import CONFIG_FILE, MODEL_FILE, NORMALISER_FILE, latest_model
from lasergym.training.config import Observation, TaskConfig, TrainingConfig
from lasergym.training.environments import make_environments, normalised
from lasergym.training.policies import policy_arguments, policy_class

__all__ = ["Agent", "AgentError", "load_agent", "load_weights"]


class AgentError(LasergymError, ValueError):
    """A model cannot be read or does not act on workpieces."""


@dataclass(frozen=True, eq=False)
class Agent:
    """A policy with all that stands between it and an environment.

    Attributes:
        policy: The policy of Stable-Baselines3.
        observation: What it sees.
        thinning: Only every such row and column is seen.
        normaliser: What normalises its observations; None where nothing does.
        task: The task it was trained on; None where the model does not tell.
    """

    policy: BasePolicy
    observation: Observation
    thinning: int = 1
    normaliser: VecNormalize | None = None
    task: TaskConfig | None = None

    def act(
        self, observations: NDArray[np.uint8], max_pulses: int | None = None
    ) -> NDArray[np.float32]:
        """The most probable actions, within [-1, 1].

        Args:
            observations: As the environments give them, shape (n, channels, 100, 100).
            max_pulses: Pulse budget of these environments, for a policy that counts the pulses
                left; None is the budget of its training.

        Returns:
            Actions, float32 of shape (n, 2).
        """
        seen: Any = thinned(observations, self.thinning)
        if self.normaliser is not None:
            seen = self.normaliser.normalize_obs(seen)
        with _budget(self.policy, max_pulses):
            actions, _ = self.policy.predict(seen, deterministic=True)
        return actions.astype(np.float32)


@contextmanager
def _budget(policy: Any, max_pulses: int | None) -> Iterator[None]:
    """Lets a policy that counts pulses count those of another budget."""
    if max_pulses is None or not isinstance(policy, SpatialPolicy):
        yield
        return
    kept, policy.max_pulses = policy.max_pulses, max_pulses
    try:
        yield
    finally:
        policy.max_pulses = kept


def load_agent(path: str | Path) -> Agent:
    """Reads an agent.

    Args:
        path: The folder of a run, whose model counts, or before it has ended that of its latest
            checkpoint; or the ``.zip`` that ``model.save`` of Stable-Baselines3 wrote. Such a file,
            and the pickled normaliser beside it, can run code: read only those you trust. Of a
            run's models nothing but the weights is read.

    Raises:
        AgentError: There is no such model, it is damaged, or its spaces are others.
        ConfigError: The configuration of the run is damaged.
    """
    path = Path(path)
    with _reading(path):
        return _of_run(path) if path.is_dir() else _of_model(path)


def load_weights(policy: ActorCriticPolicy, path: str | Path) -> None:
    """Gives a policy the weights of another; no code of the file is run.

    Args:
        policy: The policy.
        path: The folder of a run or the ``.zip`` of a model with the same networks; for
            :class:`lasergym.sb3.SpatialPolicy` also an exported ``.safetensors``, which holds the
            network alone.

    Raises:
        AgentError: There are no such weights, or they are of other networks.
    """
    path = Path(path)
    with _reading(path):
        if path.suffix == ".safetensors":
            if not isinstance(policy, SpatialPolicy):
                raise AgentError(f'{path} holds no value: take a run or a .zip, or "spatial"')
            if not path.exists():
                raise FileNotFoundError(path)
            policy.network.load_exported(load_file(path))
            return
        model = latest_model(path) if path.is_dir() else path
        if model is None:
            raise AgentError(f"{path} holds no {MODEL_FILE} and no checkpoint yet")
        policy.load_state_dict(_weights(model))


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Says of what is wrong with a file that the file is."""
    try:
        yield
    except FileNotFoundError as error:
        raise AgentError(f"there is no model {path}") from error
    except LasergymError:
        raise
    except (
        zipfile.BadZipFile,
        pickle.UnpicklingError,
        SafetensorError,
        RuntimeError,
        ValueError,
        KeyError,
        EOFError,
        AssertionError,
    ) as error:
        raise AgentError(f"{path} cannot be read as a model: {error}") from error


def _of_run(folder: Path) -> Agent:
    if not (folder / CONFIG_FILE).exists():
        raise AgentError(f"{folder} holds no run: {CONFIG_FILE} is missing")
    config = TrainingConfig.from_json(folder / CONFIG_FILE)
    model = latest_model(folder)
    if model is None:
        raise AgentError(f"{folder} holds no {MODEL_FILE} and no checkpoint yet")
    venv = make_environments(config.task, 0, 1)
    normaliser = normalised(venv, config.task, config.method.learning.gamma)
    space = venv.observation_space if normaliser is None else normaliser.observation_space
    policy = policy_class(config.policy.kind)(
        space, venv.action_space, lambda _: 0.0, **policy_arguments(config.policy, config.task)
    )
    policy.load_state_dict(_weights(model))
    if config.task.normalise_observations:
        normaliser = VecNormalize.load(str(model.with_name(NORMALISER_FILE)), venv)
        normaliser.training = False
    else:
        normaliser = None
    return Agent(policy, config.task.observation, config.task.thinning, normaliser, config.task)


def _of_model(path: Path) -> Agent:
    data, _, _ = load_from_zip_file(path, device="cpu")
    if data is None:
        raise AgentError(f"{path} does not tell its spaces: it is no model")
    observation_space, action_space = data["observation_space"], data["action_space"]
    observation, thinning = _seen(observation_space)
    if getattr(action_space, "shape", None) != (2,):
        raise AgentError(f"{path} has actions {action_space}, but must have [-1, 1]²")
    policy = data["policy_class"](
        observation_space, action_space, lambda _: 0.0, **data["policy_kwargs"]
    )
    policy.load_state_dict(_weights(path))
    normaliser = None
    for name in (NORMALISER_FILE, "vecnormalize.pkl"):
        if path.with_name(name).exists():
            venv = DummyVecEnv([lambda: _Spaces(observation_space, action_space)])
            normaliser = VecNormalize.load(str(path.with_name(name)), venv)
            normaliser.training = False
            break
    if normaliser is not None and not normaliser.norm_obs:
        normaliser = None
    return Agent(policy, observation, thinning, normaliser)


def _weights(path: Path) -> dict[str, Any]:
    """The weights of the policy; nothing else of the file is read."""
    _, parameters, _ = load_from_zip_file(path, device="cpu", load_data=False)
    weights: Any = parameters["policy"]
    return dict(weights)


def _seen(space: Any) -> tuple[Observation, int]:
    """What a model sees, from the shape of its observations."""
    shape: tuple[int, ...] = getattr(space, "shape", None) or ()
    if len(shape) == 3 and shape[1] == shape[2] and SIZE_PX % shape[1] == 0:
        for name, channels in CHANNELS.items():
            if channels == shape[0]:
                return Observation(name), SIZE_PX // shape[1]
    raise AgentError(
        f"the model sees arrays of shape {tuple(shape)}, but must see (1 or 3, 100, 100) px or "
        "these thinned"
    )


class _Spaces(gym.Env[Any, Any]):
    """Stands for the environments that a normaliser wants."""

    def __init__(self, observation_space: Any, action_space: Any) -> None:
        self.observation_space = observation_space
        self.action_space = action_space
