"""Spots of a beam that mill a depth map one after the other."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lasergym import _native

__all__ = [
    "SPOT_PLANNERS",
    "SpotPlan",
    "SpotPlannerName",
    "full_scale_um",
    "plan_spots",
]


SpotPlannerName: TypeAlias = Literal["pixel-by-pixel", "adjoint"]
"""Planners of the milling environment."""

SPOT_PLANNERS: tuple[SpotPlannerName, ...] = get_args(SpotPlannerName)
"""All of them, the fastest first."""


@dataclass(frozen=True, eq=False)
class SpotPlan:
    """Spots in the order in which they are milled, and what they achieve.

    Attributes:
        planner: Name of the planner.
        actions: The spots as actions of the environment, float32 of shape (spots, 3).
        side_um: Side of the workpiece, µm.
        longest_dwell_s: Dwell of an action of 1, s.
        reward: Sum of the rewards: 1 − the tracking error.
        tracking_error_percent: Tracking error after them, %.
        machined_fraction: Volume removed above the target over the volume of the target.
        off_target_fraction: Volume removed below the target over the volume of the target.
        elapsed_s: Time that planning took, s.
        partial: Whether the planner was stopped before it had finished.
    """

    planner: str
    actions: NDArray[np.float32]
    side_um: float
    longest_dwell_s: float
    reward: float
    tracking_error_percent: float
    machined_fraction: float
    off_target_fraction: float
    elapsed_s: float
    partial: bool

    @property
    def spots(self) -> int:
        """Number of spots."""
        return len(self.actions)

    @property
    def xy_um(self) -> NDArray[np.float64]:
        """Places of the spots, µm; shape (spots, 2)."""
        return 0.5 * (1 + self.actions[:, :2].astype(np.float64)) * self.side_um

    @property
    def dwell_s(self) -> NDArray[np.float64]:
        """Dwell of each spot, s; shape (spots,)."""
        return 0.5 * (1 + self.actions[:, 2].astype(np.float64)) * self.longest_dwell_s


def plan_spots(
    target_um: ArrayLike,
    planner: SpotPlannerName = "adjoint",
    *,
    progress: Callable[[float], bool | None] | None = None,
    **settings: Any,
) -> SpotPlan:
    """Plans all spots of an episode of ``lasergym/Milling-v0``.

    Args:
        target_um: Depth of each pixel, µm; shape (100, 100).
        planner: ``"pixel-by-pixel"`` (spots on a raster, each with the dwell of the depth there) or
            ``"adjoint"`` (dwell and y of the same spots optimised together).
        progress: Called with the fraction done; returning True stops the planner.
        settings: Arguments of the environment.

    Returns:
        The spots, and what the environment says of them.

    Raises:
        DepthMapError, EmptyTargetError, OptionError: The target or an argument cannot be used.
    """
    from lasergym.envs.milling_settings import MillingSettings

    started_s = time.perf_counter()
    native = _native.MillingEnvironment(MillingSettings(target=target_um, **settings).as_native())
    native.reset(0)
    actions, figures, episode_return, partial = native.plan(planner, progress)
    return SpotPlan(
        planner=planner,
        actions=actions,
        side_um=native.scales()[0],
        longest_dwell_s=native.scales()[2],
        reward=episode_return,
        tracking_error_percent=figures[0],
        machined_fraction=figures[1],
        off_target_fraction=figures[2],
        elapsed_s=time.perf_counter() - started_s,
        partial=partial,
    )


def full_scale_um(process: str | Path = "laser-graphite") -> float:
    """Depth of the deepest place of the milling environment's random reliefs, µm."""
    from lasergym.envs.milling_settings import MillingSettings

    return _native.MillingEnvironment(MillingSettings(process=process).as_native()).scales()[1]
