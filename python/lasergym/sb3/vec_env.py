"""Native environments as a ``VecEnv`` of Stable-Baselines3."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from lasergym.envs.native_vector import NativeVectorEnv
from lasergym.envs.vector import AblationVectorEnv
from lasergym.errors import MissingExtraError, OptionError

try:
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.vec_env import VecEnv
    from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn
except ImportError as error:
    raise MissingExtraError(
        'lasergym.sb3 needs Stable-Baselines3: pip install "lasergym[train]"'
    ) from error

__all__ = ["EnvironmentView", "NativeVecEnv", "make_vec_env"]


class EnvironmentView:
    """One environment of a :class:`NativeVecEnv`, as ``get_attr`` and ``env_method`` see it.

    Attributes that are set stay with the view and do not change the process.
    """

    def __init__(self, venv: NativeVectorEnv, index: int) -> None:
        """Views environment ``index`` of ``venv``."""
        self._venv = venv
        self.index = index
        self.action_space = venv.single_action_space
        self.observation_space = venv.single_observation_space
        self.render_mode = venv.render_mode
        self.metadata = venv.metadata
        self.spec = venv.spec
        self.settings = venv.settings

    @property
    def unwrapped(self) -> EnvironmentView:
        """The view itself: there are no wrappers."""
        return self

    def remaining(self) -> NDArray[np.bool_]:
        """Target pixels that are not machined yet, Boolean array of shape (100, 100)."""
        return self._ablation().remaining(self.index)

    def forbidden(self) -> NDArray[np.bool_]:
        """Pristine pixels that must stay, Boolean array of shape (100, 100)."""
        return self._ablation().forbidden(self.index)

    def _ablation(self) -> AblationVectorEnv:
        if not isinstance(self._venv, AblationVectorEnv):
            raise OptionError("only pulse-ablation environments have remaining pixels")
        return self._venv

    def render(self) -> NDArray[np.uint8] | None:
        """A picture, uint8 of shape (400, 400, 3), with ``render_mode="rgb_array"``."""
        return self._venv.render_one(self.index)


class NativeVecEnv(VecEnv):
    """A Stable-Baselines3 ``VecEnv`` over native environments.

    Step for step equal to ``DummyVecEnv`` over monitored single environments: an episode that ends
    is reset in the same step, ``infos[i]`` holds its ``terminal_observation`` (a copy),
    ``TimeLimit.truncated``, ``is_success`` and ``episode`` (return ``r``, length ``l``, duration
    ``t``). No ``VecMonitor`` is needed.
    """

    def __init__(self, venv: NativeVectorEnv) -> None:
        """Adapts ``venv``, whose autoreset mode must be ``SAME_STEP``."""
        if venv.metadata["autoreset_mode"] != AutoresetMode.SAME_STEP:
            raise OptionError(
                "Stable-Baselines3 resets in the same step: make the environments with "
                "autoreset_mode=AutoresetMode.SAME_STEP, or call lasergym.sb3.make_vec_env"
            )
        self.venv = venv
        self.views = [EnvironmentView(venv, index) for index in range(venv.num_envs)]
        self._actions: NDArray[np.float32] | None = None
        super().__init__(venv.num_envs, venv.single_observation_space, venv.single_action_space)

    def reset(self) -> NDArray[np.uint8]:
        """Resets all environments.

        The seeds of ``seed()`` and the options of ``set_options()`` apply once.

        Returns:
            Observations, uint8 of shape (n, channels, 100, 100).
        """
        targets = [options.get("target") for options in self._options]
        unknown = sorted({key for options in self._options for key in options} - {"target"})
        if unknown:
            raise OptionError(f"unknown reset options {unknown}: `target` is the only one")
        options = {"target": targets} if any(target is not None for target in targets) else None
        observations, infos = self.venv.reset(seed=self._seeds, options=options)
        self.reset_infos = _rows(infos, self.num_envs)
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: NDArray[np.float32]) -> None:
        """Takes the actions of the next step, shape (n, length of one action)."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Does one step in every environment.

        Returns:
            Observations, rewards (float32), dones and infos.
        """
        if self._actions is None:
            raise OptionError("step_wait() needs step_async(actions) first")
        observations, rewards, terminated, truncated, infos = self.venv.step(self._actions)
        self._actions = None
        dones = terminated | truncated
        rows = _rows(infos, self.num_envs)
        for row in rows:
            row["TimeLimit.truncated"] = False
        if dones.any():
            finals = _rows(infos["final_info"], self.num_envs)
            episode = {key: values.tolist() for key, values in infos["episode"].items()}
            for index in np.flatnonzero(dones).tolist():
                self.reset_infos[index] = rows[index]
                del self.reset_infos[index]["TimeLimit.truncated"]
                rows[index] = finals[index] | {
                    "TimeLimit.truncated": bool(truncated[index] and not terminated[index]),
                    "terminal_observation": infos["final_obs"][index].copy(),
                    "episode": {
                        "r": round(episode["r"][index], 6),
                        "l": episode["l"][index],
                        "t": round(episode["t"][index], 6),
                    },
                }
        return observations, rewards.astype(np.float32), dones, rows

    def close(self) -> None:
        """Closes the environments."""
        self.venv.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """An attribute of the chosen environments, see :class:`EnvironmentView`."""
        return [getattr(view, attr_name) for view in self._chosen(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Sets an attribute of the chosen views; process settings are fixed when made."""
        for view in self._chosen(indices):
            setattr(view, attr_name, value)

    def env_method(
        self,
        method_name: str,
        *method_args: Any,
        indices: VecEnvIndices = None,
        **method_kwargs: Any,
    ) -> list[Any]:
        """Calls a method of the chosen environments, see :class:`EnvironmentView`."""
        return [
            getattr(view, method_name)(*method_args, **method_kwargs)
            for view in self._chosen(indices)
        ]

    def env_is_wrapped(
        self, wrapper_class: type[gym.Wrapper[Any, Any, Any, Any]], indices: VecEnvIndices = None
    ) -> list[bool]:
        """True for ``Monitor`` alone, whose ``info["episode"]`` is written natively."""
        return [wrapper_class is Monitor for _ in self._chosen(indices)]

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """A picture of every environment with ``render_mode="rgb_array"``, else None for each."""
        return [view.render() for view in self.views]

    def _chosen(self, indices: VecEnvIndices) -> list[EnvironmentView]:
        return [self.views[index] for index in self._get_indices(indices)]


def make_vec_env(
    env_id: str, n_envs: int = 1, seed: int | None = None, **settings: Any
) -> NativeVecEnv:
    """Makes native environments for Stable-Baselines3.

    Args:
        env_id: An id of lasergym, for instance ``"lasergym/Star-v0"``.
        n_envs: Number of environments, at least 1.
        seed: Environment ``i`` is seeded with ``seed + i`` at the first reset; None seeds from the
            system.
        **settings: Arguments of the environment, and ``threads``, ``max_episode_steps`` and
            ``render_mode`` of its vector version.

    Returns:
        The environments, ready for ``PPO(policy, env)``.
    """
    venv = gym.make_vec(
        env_id,
        num_envs=n_envs,
        vectorization_mode="vector_entry_point",
        autoreset_mode=AutoresetMode.SAME_STEP,
        **settings,
    )
    if not isinstance(venv, NativeVectorEnv):
        raise OptionError(f"{env_id!r} has no native vector version")
    adapter = NativeVecEnv(venv)
    adapter.seed(seed)
    return adapter


def _rows(infos: dict[str, Any], count: int) -> list[dict[str, Any]]:
    """Infos of a vector environment as one dict an environment, scalar keys only."""
    rows: list[dict[str, Any]] = [{} for _ in range(count)]
    for key, values in infos.items():
        mask = infos.get(f"_{key}")
        if key.startswith("_") or not isinstance(values, np.ndarray) or values.ndim != 1:
            continue
        pairs: Iterable[tuple[int, Any]] = enumerate(values.tolist())
        if mask is not None and not mask.all():
            present = mask.tolist()
            pairs = ((index, value) for index, value in pairs if present[index])
        for index, value in pairs:
            rows[index][key] = value
    return rows
