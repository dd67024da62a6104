"""One line on a scan head: how far to extend it, and when to switch the laser."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from lasergym import _native
from lasergym.envs.seeded_vector import SeededVectorEnv, autoreset_mode_of
from lasergym.envs.settings import MAX_COUNT, action_array, batched_box, native_seed
from lasergym.errors import EpisodeOverError, OptionError, RenderModeError
from lasergym.options import integer_in

__all__ = ["GalvoLineEnv", "GalvoLineVectorEnv"]

_KEYS = ("start_error_um", "end_error_um", "pitch_deviation", "time_us")


def _spaces() -> tuple[gym.spaces.Box[np.float32], gym.spaces.Box[np.float32]]:
    """The spaces of observations and actions."""
    return (
        gym.spaces.Box(-1.0, 1.0, (6,), np.float32),
        gym.spaces.Box(-1.0, 1.0, (4,), np.float32),
    )


class GalvoLineEnv(gym.Env[NDArray[np.float32], NDArray[np.float32]]):
    """One line on an unknown scan head, machined in one step.

    ## Description
    The mirrors of a scan head lag behind their command, so that lines come out short and pulses
    pile up where the mirror accelerates. The agent extends the line at both ends and delays the
    laser, so that the line comes out as drawn with pulses equally far apart. A new head (Bessel,
    second-order, dead-time or constant-acceleration-time), speed (0.25 to 2 m/s), length (80 to
    2000 µm) and direction are drawn in every episode; of the head only the noisy measures of test
    lines are known. This is a contextual bandit: an episode is one step.

    ## Action Space
    `Box(-1, 1, (4,), float32)`: run-in (0 to 6), run-out (0 to 3), laser on after the start of the
    extended line (0 to 9), last pulse after its end (-3 to 3), each in measured lags. What exceeds
    [-1, 1] is clipped; NaN is an error.

    ## Observation Space
    `Box(-1, 1, (6,), float32)`: speed, logarithm of the length, cosine and sine of the direction,
    measured lag (0 to 500 µs), measured acceleration length at 2 % over lag (0 to 6).

    ## Rewards
    −(|start error| + |end error|)/`edge_scale_um` − largest |pitch − 1|/`pitch_scale` − time beyond
    that of the drawn line/`time_scale_us`, at least −20.

    ## Starting State
    A head at rest.

    ## Episode Termination
    After one step; never truncated.

    ## Information
    After the step: `start_error_um`, `end_error_um` (of the craters' edges along the line),
    `pitch_deviation`, `time_us`; NaN where no pulse fired.

    ## Arguments
    ```python
    gym.make("lasergym/GalvoLine-v0", noise_um=0.0)
    ```
    * `noise_um` (1.5): standard deviation of the measured lengths of the test line at 1 m/s, µm.
    * `edge_scale_um` (10.0): edge error that costs 1, µm.
    * `pitch_scale` (0.05): deviation of the pitch that costs 1.
    * `time_scale_us` (2000.0): time that costs 1, µs.

    ## Baseline
    `env.unwrapped.baseline_action()` is what the adaptive postprocessor does.

    ## Version History
    * v0: first version.

    ## References
    Penchev et al., adaptive postprocessor for beam deflector dynamics.
    """

    # Gymnasium declares it without ClassVar.
    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}  # type: ignore[misc]

    def __init__(
        self,
        *,
        noise_um: float = 1.5,
        edge_scale_um: float = 10.0,
        pitch_scale: float = 0.05,
        time_scale_us: float = 2000.0,
        render_mode: str | None = None,
    ) -> None:
        """Makes the environment; see the class for the arguments."""
        if render_mode is not None:
            raise RenderModeError(f"render_mode is {render_mode!r}, but there is none")
        self.render_mode = None
        self.observation_space, self.action_space = _spaces()
        self._native = _native.GalvoLines(1, noise_um, edge_scale_um, pitch_scale, time_scale_us)
        self._seeded = False
        self._over = True

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Draws a head and a line.

        Args:
            seed: Starts the random stream anew; without it the stream goes on.
            options: None are known.
        """
        super().reset(seed=seed)
        if options:
            raise OptionError(f"unknown reset options {sorted(options)}: there are none")
        fresh = None
        if seed is not None or not self._seeded:
            fresh = native_seed(self.np_random)
            self._seeded = True
        self._native.reset([fresh], None)
        self._over = False
        return self._native.observations()[0], {}

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Machines the line.

        Args:
            action: float32 of shape (4,); what exceeds [-1, 1] is clipped.

        Raises:
            ActionError: The action has the wrong shape or dtype, or is not finite.
            EpisodeOverError: The line is machined already.
        """
        if self._over:
            raise EpisodeOverError("the line is machined already: call reset first")
        rewards, *figures = self._native.step(action_array(action, (4,))[None])
        self._over = True
        info = {key: float(values[0]) for key, values in zip(_KEYS, figures, strict=True)}
        return self._native.observations()[0], float(rewards[0]), True, False, info

    def baseline_action(self) -> NDArray[np.float32]:
        """What the adaptive postprocessor does with this line, from what the agent observes."""
        action: NDArray[np.float32] = self._native.baselines()[0]
        return action


class GalvoLineVectorEnv(SeededVectorEnv[NDArray[np.float32], NDArray[np.float32]]):
    """Many lines at once, equal to single environments bit for bit.

    ``gym.make_vec("lasergym/GalvoLine-v0", num_envs=64)`` makes it. The arguments of
    :class:`GalvoLineEnv` apply; besides them:

    Args:
        num_envs: Number of environments, at least 1.
        autoreset_mode: What happens at the end of an episode: ``NEXT_STEP`` (default) resets in the
            step after, ``SAME_STEP`` at once, with ``infos["final_obs"]`` and
            ``infos["final_info"]``, ``DISABLED`` leaves it to
            ``reset(options={"reset_mask": mask})``.
        episode_statistics: Whether ``infos["episode"]`` holds return ``r``, length ``l`` and
            duration ``t`` of the episodes that end.
    """

    def __init__(
        self,
        *,
        num_envs: int = 1,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        episode_statistics: bool = True,
        noise_um: float = 1.5,
        edge_scale_um: float = 10.0,
        pitch_scale: float = 0.05,
        time_scale_us: float = 2000.0,
        render_mode: str | None = None,
    ) -> None:
        """Makes the environments; see the class for the arguments."""
        super().__init__()
        if render_mode is not None:
            raise RenderModeError(f"render_mode is {render_mode!r}, but there is none")
        self.render_mode = None
        self.autoreset_mode = autoreset_mode_of(autoreset_mode)
        self.num_envs = integer_in("num_envs", num_envs, 1, MAX_COUNT)
        self.metadata = {"render_modes": [], "autoreset_mode": self.autoreset_mode}
        self.single_observation_space, self.single_action_space = _spaces()
        self.observation_space = batched_box(self.single_observation_space, num_envs)
        self.action_space = batched_box(self.single_action_space, num_envs)
        self.episode_statistics = episode_statistics
        self._native = _native.GalvoLines(
            num_envs, noise_um, edge_scale_um, pitch_scale, time_scale_us
        )
        self._over = np.ones(num_envs, np.bool_)
        self._started_s = np.zeros(num_envs)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Draws heads and lines.

        Args:
            seed: Environment ``i`` gets ``seed + i``, or ``seed[i]`` from a sequence; without, the
                streams go on.
            options: ``{"reset_mask": mask}`` resets only where the mask is True.
        """
        options = options or {}
        unknown = sorted(options.keys() - {"reset_mask"})
        if unknown:
            raise OptionError(f"unknown reset options {unknown}: there is `reset_mask`")
        mask = self._reset_mask(options.get("reset_mask"))
        seeds = self._native_seeds(seed, mask)
        self._draw(seeds, np.ones(self.num_envs, np.bool_) if mask is None else mask)
        return self._native.observations(), {}

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[
        NDArray[np.float32],
        NDArray[np.float64],
        NDArray[np.bool_],
        NDArray[np.bool_],
        dict[str, Any],
    ]:
        """Machines every line.

        Args:
            actions: float32 of shape (num_envs, 4).

        Raises:
            ActionError: Wrong shape or dtype, or a component that is not finite; nothing has
                happened.
            EpisodeOverError: A line is machined already and nobody resets it.
        """
        array = action_array(actions, (self.num_envs, 4))
        resets = self._over.copy()
        if resets.any() and self.autoreset_mode != AutoresetMode.NEXT_STEP:
            raise EpisodeOverError("lines are machined already: reset them first")
        rewards, *figures = self._native.step(array)
        done = ~resets
        infos: dict[str, Any] = {}
        for key, values in zip(_KEYS, figures, strict=True):
            infos[key] = np.where(done, values, 0.0)
            infos[f"_{key}"] = done.copy()
        rewards = np.where(done, rewards, 0.0)
        self._over = done.copy()
        if self.episode_statistics and done.any():
            now_s = time.perf_counter()
            infos["episode"] = {
                "r": rewards,
                "l": done.astype(np.int64),
                "t": np.where(done, now_s - self._started_s, 0.0),
            }
            infos["_episode"] = done.copy()
        observations = self._native.observations()
        if self.autoreset_mode == AutoresetMode.SAME_STEP:
            final = {key: infos.pop(key) for key in [*_KEYS, *(f"_{key}" for key in _KEYS)]}
            infos |= {"final_obs": observations, "_final_obs": done.copy()}
            infos |= {"final_info": final, "_final_info": done.copy()}
            self._draw([None] * self.num_envs, done)
            observations = self._native.observations()
        elif resets.any():
            self._draw([None] * self.num_envs, resets)
            observations = self._native.observations()
        return observations, rewards, done, np.zeros(self.num_envs, np.bool_), infos

    def baseline_actions(self) -> NDArray[np.float32]:
        """What the adaptive postprocessor does with the lines, shape (num_envs, 4)."""
        return self._native.baselines()

    def _draw(self, seeds: list[int | None], where: NDArray[np.bool_]) -> None:
        self._native.reset(seeds, where.tolist())
        self._over[where] = False
        self._started_s[where] = time.perf_counter()
