"""Pulse-by-pulse laser ablation as Gymnasium environments."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from lasergym import _native
from lasergym.envs.native_env import NativeEnv
from lasergym.envs.settings import ObservationMode, Settings, Task, action_array
from lasergym.render import Trajectory, ansi_frame
from lasergym.targets import Target, TargetLike, as_target

__all__ = ["AblationEnv", "PatternEnv", "RandomShapeEnv", "RotatedStarEnv", "StarEnv"]


class AblationEnv(NativeEnv[NDArray[np.uint8], NDArray[np.float32]]):
    """Pulse-by-pulse laser ablation; the base of the four environments.

    See :class:`StarEnv` for spaces, rewards and arguments.
    """

    progress_keys = ("machined_fraction", "off_target_fraction", "pulses")
    as_target = as_target
    task: ClassVar[Task]
    settings: Settings
    _native: _native.Environment

    def __init__(
        self,
        *,
        target: TargetLike | None = None,
        observation: ObservationMode = "remaining",
        pulse_radius_px: float = 9.0,
        max_pulses: int = 45,
        completion: float = 0.99,
        pointing_error_px: float = 0.0,
        radius_error: float = 0.0,
        stop_on_miss: bool = False,
        render_mode: str | None = None,
    ) -> None:
        """Makes the environment; see the class for the arguments."""
        settings = Settings(
            task=self.task,
            target=target,
            observation=observation,
            pulse_radius_px=pulse_radius_px,
            max_pulses=max_pulses,
            completion=completion,
            pointing_error_px=pointing_error_px,
            radius_error=radius_error,
            stop_on_miss=stop_on_miss,
        )
        self._make(settings, _native.Environment, render_mode)
        self._trajectory: Trajectory | None = None

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.uint8], float, bool, bool, dict[str, Any]]:
        """Fires one pulse at x = 50 (1 + a₀), y = 50 (1 + a₁) px.

        Args:
            action: float32 of shape (2,); what exceeds [-1, 1] is clipped.

        Returns:
            Observation, reward, terminated, truncated (always False), info.

        Raises:
            ActionError: The action has the wrong shape or dtype, or is not finite.
            EpisodeOverError: The episode is over or has not begun.
        """
        x, y = action_array(action, (2,)).tolist()
        reward, terminated, x_px, y_px, radius_px = self._native.step(x, y)
        if self._trajectory is not None:
            self._trajectory.add(x_px, y_px, radius_px)
        return self._stepped(reward, terminated)

    def remaining(self) -> Target:
        """Target pixels that are not machined yet, Boolean array of shape (100, 100)."""
        return self._native.layers()[0]

    def forbidden(self) -> Target:
        """Pristine pixels that must stay, Boolean array of shape (100, 100)."""
        return self._native.layers()[1]

    def clone_state(self) -> Any:
        """A copy of the whole state, random stream included, for :meth:`restore_state`."""
        trajectory = None if self._trajectory is None else self._trajectory.copy()
        return super().clone_state(), trajectory

    def restore_state(self, state: Any) -> None:
        """Goes back to a state of :meth:`clone_state`; the state can be restored again."""
        native, trajectory = state
        super().restore_state(native)
        self._trajectory = None if trajectory is None else trajectory.copy()

    def _begun(self) -> None:
        if self.render_mode in ("rgb_array", "human"):
            self._trajectory = Trajectory(self.remaining(), self.settings.pulse_radius_px)

    def _text(self) -> str:
        remaining, forbidden = self._native.layers()
        return ansi_frame(remaining, forbidden, *self._native.progress())

    def _picture(self) -> NDArray[np.uint8] | None:
        return None if self._trajectory is None else self._trajectory.rgb_array()


class StarEnv(AblationEnv):
    """A five-pointed star, machined pulse by pulse.

    ## Description
    A laser removes material from a workpiece of 100 × 100 px (1 px = 1 µm), one pulse at a time.
    Each pulse machines a disc of 18 µm diameter wherever the agent aims. The target is always the
    same upright star of 4842 px; the task is to machine as much of it, and as little beside it, as
    the pulse budget allows. This is the first task of Xie et al. (2022), section 3.1.

    ## Action Space
    `Box(-1, 1, (2,), float32)`: the pulse lands at x = 50 (1 + a₀), y = 50 (1 + a₁) px, x to the
    right, y down. Positions are continuous. What exceeds [-1, 1] is clipped; NaN is an error.

    ## Observation Space
    `observation="remaining"` (what the paper's agent sees): `Box(0, 255, (1, 100, 100), uint8)`,
    255 where target remains, 0 elsewhere.

    `observation="layers"`: `Box(0, 255, (3, 100, 100), uint8)`: remaining target, pristine ground
    that must stay, and pulses left / `max_pulses` (scaled to 255) everywhere. With it the process
    is Markov.

    ## Rewards
    (target pixels machined by the pulse − pixels machined beside the target) / 10 000. Ground that
    is machined already is free. The return is (target machined − off-target machined) / workpiece
    area.

    ## Starting State
    A pristine workpiece.

    ## Episode Termination
    The episode terminates when `completion` of the target is machined, when `max_pulses` pulses are
    used, or, with `stop_on_miss`, when a pulse machines no target. It is never truncated, except by
    `max_episode_steps` of `gym.make`.

    ## Information
    `machined_fraction` (of the target), `off_target_fraction` (area machined beside the target over
    the area of the target), `pulses`, and at the end `is_success` (`completion` reached).

    ## Arguments
    ```python
    gym.make("lasergym/Star-v0", observation="layers", max_pulses=40, render_mode="rgb_array")
    ```
    * `observation`: `"remaining"` (default) or `"layers"`.
    * `pulse_radius_px` (9.0): radius of the disc that a pulse machines, px, in (0, 50].
    * `max_pulses` (45): pulse budget, at least 1.
    * `completion` (0.99): machined fraction that completes the target, in (0, 1].
    * `pointing_error_px` (0.0): standard deviation of each pulse's displacement along x and along
      y, px.
    * `radius_error` (0.0): relative standard deviation of each pulse's radius, in [0, 0.5].
    * `stop_on_miss` (False): whether a pulse that machines no target ends the episode.
    * `render_mode`: `"rgb_array"`, `"ansi"`, or `"human"` (needs the extra `lasergym[human]`).

    ## Reset Arguments
    `env.reset(options={"target": ...})` machines another target in this episode: a Boolean array of
    shape (100, 100) or the name of a PNG, JPEG, SVG or DXF file.

    ## Version History
    * v0: first version.

    ## References
    Y. Xie, M. Praeger, J. A. Grant-Jacob, R. W. Eason, B. Mills, "Motion control for laser
    machining via reinforcement learning", Optics Express (2022).
    """

    task = "star"


class RotatedStarEnv(AblationEnv):
    """The star turned by a random angle, machined pulse by pulse.

    ## Description
    The star of `lasergym/Star-v0`, turned about the centre of the workpiece by an angle uniform in
    [0, 360)°. Tips that leave the workpiece are lost. This is the second task of Xie et al. (2022),
    section 3.2.

    ## Action Space
    As `lasergym/Star-v0`: `Box(-1, 1, (2,), float32)`, the position of the next pulse.

    ## Observation Space
    As `lasergym/Star-v0`: `Box(0, 255, (1, 100, 100), uint8)` or, with `observation="layers"`,
    `Box(0, 255, (3, 100, 100), uint8)`.

    ## Rewards
    (target pixels machined by the pulse − pixels machined beside the target) / 10 000.

    ## Starting State
    A pristine workpiece and a new random angle.

    ## Episode Termination
    As `lasergym/Star-v0`.

    ## Information
    As `lasergym/Star-v0`.

    ## Arguments
    As `lasergym/Star-v0`.

    ## Reset Arguments
    As `lasergym/Star-v0`: `{"target": ...}`, for instance `lasergym.targets.star(angle_deg=30)`.

    ## Version History
    * v0: first version.

    ## References
    See `lasergym/Star-v0`.
    """

    task = "rotated-star"


class RandomShapeEnv(AblationEnv):
    """A new random shape in every episode, machined pulse by pulse.

    ## Description
    The target is a smooth random shape: seven random pixel centres, sorted by angle about their
    centroid and joined by Bézier segments, redrawn while the area is under 3000 px. Some shapes
    have features that are smaller than a pulse. This is the third task of Xie et al. (2022),
    section 3.3: a policy that solves it machines arbitrary patterns.

    ## Action Space
    As `lasergym/Star-v0`: `Box(-1, 1, (2,), float32)`, the position of the next pulse.

    ## Observation Space
    As `lasergym/Star-v0`: `Box(0, 255, (1, 100, 100), uint8)` or, with `observation="layers"`,
    `Box(0, 255, (3, 100, 100), uint8)`.

    ## Rewards
    (target pixels machined by the pulse − pixels machined beside the target) / 10 000.

    ## Starting State
    A pristine workpiece and a new random shape.

    ## Episode Termination
    As `lasergym/Star-v0`.

    ## Information
    As `lasergym/Star-v0`.

    ## Arguments
    As `lasergym/Star-v0`.

    ## Reset Arguments
    As `lasergym/Star-v0`: `{"target": ...}`, for instance `lasergym.targets.random_shape(seed=7)`.

    ## Version History
    * v0: first version.

    ## References
    See `lasergym/Star-v0`.
    """

    task = "random-shape"


class PatternEnv(AblationEnv):
    """A pattern of your own, machined pulse by pulse.

    ## Description
    The target is the pattern given as `target`: a Boolean array of shape (100, 100), or the name of
    a PNG, JPEG, SVG or DXF file, which is scaled to the workpiece. Without it, the star.

    ## Action Space
    As `lasergym/Star-v0`: `Box(-1, 1, (2,), float32)`, the position of the next pulse.

    ## Observation Space
    As `lasergym/Star-v0`: `Box(0, 255, (1, 100, 100), uint8)` or, with `observation="layers"`,
    `Box(0, 255, (3, 100, 100), uint8)`.

    ## Rewards
    (target pixels machined by the pulse − pixels machined beside the target) / 10 000.

    ## Starting State
    A pristine workpiece.

    ## Episode Termination
    As `lasergym/Star-v0`.

    ## Information
    As `lasergym/Star-v0`.

    ## Arguments
    ```python
    gym.make("lasergym/Pattern-v0", target="logo.svg", max_pulses=60)
    ```
    * `target`: the pattern or the name of a drawing (default: the star).
    * The others as `lasergym/Star-v0`.

    ## Reset Arguments
    As `lasergym/Star-v0`.

    ## Version History
    * v0: first version.

    ## References
    See `lasergym/Star-v0`.
    """

    task = "pattern"

    def __init__(self, *, target: TargetLike | None = None, **settings: Any) -> None:
        """Makes the environment; see the class for the arguments."""
        super().__init__(target=_native.star(0.0) if target is None else target, **settings)
