"""What single environments of all processes share: seeds, infos, pictures, states."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, TypeVar

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from lasergym.envs.settings import native_seed
from lasergym.errors import OptionError, RenderModeError

__all__ = ["NativeEnv"]

ObservationT = TypeVar("ObservationT")
ActionT = TypeVar("ActionT")


class NativeEnv(gym.Env[ObservationT, ActionT]):
    """A single environment whose process is native code."""

    # Gymnasium declares it without ClassVar.
    metadata: ClassVar[dict[str, Any]] = {  # type: ignore[misc]
        "render_modes": ["rgb_array", "human", "ansi"],
        "render_fps": 10,
    }
    progress_keys: ClassVar[tuple[str, ...]]
    """Names of the figures that say how far an episode is."""
    as_target: ClassVar[Callable[[Any], Any] | None] = None
    """How the reset option ``target`` becomes a native target; None where there is no such option.
    """
    settings: Any
    _native: Any

    def _make(
        self, settings: Any, native: Callable[[dict[str, Any]], Any], render_mode: str | None
    ) -> None:
        """Makes the spaces and the process of ``settings``.

        Raises:
            RenderModeError: There is no such render mode.
        """
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            modes = ", ".join(f'"{mode}"' for mode in self.metadata["render_modes"])
            raise RenderModeError(f"render_mode is {render_mode!r}, but must be one of {modes}")
        self.settings = settings
        self.observation_space = settings.observation_space()
        self.action_space = settings.action_space()
        self.render_mode = render_mode
        self._native = native(settings.as_native())
        self._seeded = False
        self._window: Any = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[ObservationT, dict[str, Any]]:
        """Begins an episode.

        Args:
            seed: Starts the random stream anew; without it the stream goes on.
            options: See "Reset Arguments" of the class.

        Returns:
            The first observation and its info.

        Raises:
            OptionError: There is no such option.
        """
        super().reset(seed=seed)
        target = self._target_of(options or {})
        fresh_seed = None
        if seed is not None or not self._seeded:
            fresh_seed = native_seed(self.np_random)
            self._seeded = True
        self._native.reset(fresh_seed)
        if target is not None:
            self._native.reset_to(target)
        self._begun()
        if self.render_mode == "human":
            self.render()
        return self._native.observation(), self._info()

    def render(self) -> Any:
        """The workpiece as it is now.

        Returns:
            For ``"rgb_array"`` a picture (uint8 of shape (400, 400, 3)), for ``"ansi"`` text, for
            ``"human"`` nothing: the picture is shown in a window.
        """
        if self.render_mode is None:
            gym.logger.warn("render() needs a render mode: gym.make(..., render_mode='rgb_array')")
            return None
        if self.render_mode == "ansi":
            return self._text()
        frame = self._picture()
        if frame is None:
            gym.logger.warn("render() needs a reset first")
            return None
        if self.render_mode == "rgb_array":
            return frame
        if self._window is None:
            from lasergym.envs.window import Window

            self._window = Window(type(self).__name__, self.metadata["render_fps"])
        self._window.show(frame)
        return None

    def close(self) -> None:
        """Closes the window, if there is one; may be called twice."""
        if self._window is not None:
            self._window.close()
            self._window = None

    def clone_state(self) -> Any:
        """A copy of the whole state, random stream included, for :meth:`restore_state`."""
        return self._native.copy()

    def restore_state(self, state: Any) -> None:
        """Goes back to a state of :meth:`clone_state`; the state can be restored again."""
        self._native = state.copy()
        self._seeded = True

    def _stepped(
        self, reward: float, terminated: bool
    ) -> tuple[ObservationT, float, bool, bool, dict[str, Any]]:
        """What a step answers."""
        info = self._info()
        if terminated:
            info["is_success"] = self._native.is_success()
        if self.render_mode == "human":
            self.render()
        return self._native.observation(), reward, terminated, False, info

    def _info(self) -> dict[str, Any]:
        return dict(zip(self.progress_keys, self._native.progress(), strict=True))

    def _target_of(self, options: dict[str, Any]) -> Any:
        """The native target that reset options name, if any."""
        as_target = type(self).as_target
        known = set() if as_target is None else {"target"}
        unknown = sorted(options.keys() - known)
        if unknown:
            there = "there are none" if as_target is None else "`target` is the only one"
            raise OptionError(f"unknown reset options {unknown}: {there}")
        target = options.get("target")
        return None if as_target is None or target is None else as_target(target)

    def _begun(self) -> None:
        """An episode has begun."""

    def _text(self) -> str:
        """The workpiece as text."""
        raise NotImplementedError

    def _picture(self) -> NDArray[np.uint8] | None:
        """The workpiece as a picture, uint8 of shape (400, 400, 3); None before the first reset."""
        raise NotImplementedError
