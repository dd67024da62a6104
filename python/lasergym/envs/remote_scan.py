"""Robot and scanner as a Gymnasium environment: which subtask next, and on which line."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from lasergym import _native
from lasergym.envs.native_env import NativeEnv
from lasergym.envs.remote_settings import RemoteScanSettings, scan_action

__all__ = ["RemoteScanEnv"]

_SIDE_PX = 400
_GROUND = (255, 255, 255)
_OPEN = (120, 120, 120)
_DONE = (46, 125, 50)
_LINE = (0, 102, 204)


class RemoteScanEnv(NativeEnv[NDArray[np.float32], NDArray[np.int64]]):
    """Remote cutting and welding by robot and scanner, planned subtask by subtask.

    ## Description
    Holes to be cut and seams to be welded are spread over a sheet. A robot carries a laser scanner
    over it on straight lines; while it moves, the scanner processes the subtasks of the line one
    after the other, each for as long as it lies in the working field. The agent chooses which
    subtask is next, and whether the robot goes on with its line or begins a new one, and in which
    direction. Offset, speed and ends of every line are optimal for what is on it (Hatwig et al.
    2012). The layout is new in every episode.

    ## Action Space
    `MultiDiscrete([subtasks, 17])`: the subtask and the direction. Direction 0 goes on with the
    line in its direction, where the subtask can be processed after the others; where it cannot, a
    new line begins towards it. Direction k from 1 on begins a new line at (k - 1) · 22.5°.

    ## Observation Space
    `Box(-1, 2, (6 + 6 · subtasks,), float32)`. The robot: x and y in parts of the sheet, cosine and
    sine of its line, whether there is a line, part of the steps used. Then for each subtask: x, y,
    radius of its scan circle in parts of the field, time of its process in parts of 4 s, whether it
    is done, whether the line can go on with it.

    ## Rewards
    Minus the time that the choice adds, s. A subtask that is done already costs 1 s and does
    nothing. The return is minus the cycle time where nothing is chosen twice.

    ## Starting State
    A new random layout; nothing is done.

    ## Episode Termination
    The episode terminates when all subtasks are done or after 2 · `subtasks` steps. It is never
    truncated, except by `max_episode_steps` of `gym.make`.

    ## Information
    `done` (subtasks), `lines`, `cycle_time_s`, and at the end `is_success` (everything is done).

    ## Arguments
    ```python
    gym.make("lasergym/RemoteScan-v0", subtasks=30, render_mode="rgb_array")
    ```
    * `subtasks` (12): number of subtasks, from 1 to 1000.
    * `area_mm2` (75 000): area of the sheet for each of them, mm².
    * `welded` (0.2): part of the subtasks that are welded.
    * `render_mode`: `"rgb_array"`, `"ansi"`, or `"human"` (needs the extra `lasergym[human]`).

    ## Baseline
    `env.unwrapped.planned()` gives the cycle times of the planner's joint choice and of the paper's
    greedy one for the layout of the episode, and the planner's choices as actions.

    ## Version History
    * v0: first version.

    ## References
    J. Hatwig, P. Minnerup, M. F. Zaeh, G. Reinhart, "An automated path planning system for a robot
    with a laser scanner for remote laser cutting and welding" (2012).
    """

    # Gymnasium declares it without ClassVar.
    metadata: ClassVar[dict[str, Any]] = {  # type: ignore[misc]
        **NativeEnv.metadata,
        "render_fps": 4,
    }
    progress_keys = ("done", "lines", "cycle_time_s")
    settings: RemoteScanSettings
    _native: _native.RemoteEnvironment

    def __init__(
        self,
        *,
        subtasks: int = 12,
        area_mm2: float = 75_000.0,
        welded: float = 0.2,
        render_mode: str | None = None,
    ) -> None:
        """Makes the environment; see the class for the arguments."""
        settings = RemoteScanSettings(subtasks=subtasks, area_mm2=area_mm2, welded=welded)
        self._make(settings, _native.RemoteEnvironment, render_mode)

    def step(
        self, action: NDArray[np.int64]
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Chooses the next subtask and its line.

        Args:
            action: (subtask, direction), integers.

        Returns:
            Observation, reward, terminated, truncated (always False), info.

        Raises:
            ActionError: The action has the wrong shape or dtype, or names no subtask or direction.
            EpisodeOverError: The episode is over or has not begun.
        """
        subtask, direction = scan_action(action, (2,)).tolist()
        reward, terminated = self._native.step(subtask, direction)
        return self._stepped(reward, terminated)

    def planned(self) -> tuple[float, float, list[tuple[int, int]]]:
        """What the planner does with this layout.

        Returns:
            Cycle time of its joint choice and of the paper's greedy one, s, and the joint choice as
            actions. Their directions are rounded to 22.5°, so that the actions take longer than the
            plan.
        """
        return self._native.planned()

    def _text(self) -> str:
        done, lines, cycle_time_s = self._native.progress()
        return (
            f"{done} of {self.settings.subtasks} subtasks on {lines} lines, {cycle_time_s:.3f} s\n"
        )

    def _picture(self) -> NDArray[np.uint8]:
        """The sheet with subtasks (grey, done green) and lines (blue)."""
        side_mm, subtasks, done, lines = self._native.picture()
        picture = np.full((_SIDE_PX, _SIDE_PX, 3), _GROUND, np.uint8)
        # Lines and circles may reach a tenth of the side beyond the sheet.
        per_mm = _SIDE_PX / (1.2 * side_mm)
        rows, columns = np.mgrid[0:_SIDE_PX, 0:_SIDE_PX]
        x = (columns + 0.5) / per_mm - 0.1 * side_mm
        y = (_SIDE_PX - rows - 0.5) / per_mm - 0.1 * side_mm
        for (cx, cy, radius), is_done in zip(subtasks, done, strict=True):
            near = np.hypot(x - cx, y - cy) <= max(radius, 1.5 / per_mm)
            picture[near] = _DONE if is_done else _OPEN
        for start, end in lines:
            count = int(2 * np.hypot(end[0] - start[0], end[1] - start[1]) * per_mm) + 2
            along = np.linspace(start, end, count)
            column = ((along[:, 0] + 0.1 * side_mm) * per_mm).astype(int)
            row = (_SIDE_PX - (along[:, 1] + 0.1 * side_mm) * per_mm).astype(int)
            for shift in (0, 1):
                inside = (column >= 0) & (column < _SIDE_PX) & (row >= 0) & (row + shift < _SIDE_PX)
                picture[row[inside] + shift, column[inside]] = _LINE
        return picture
