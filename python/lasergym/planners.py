"""Planners: where the pulses of a job go, and what anyone's pulses achieve."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lasergym import _native
from lasergym.errors import OptionError, PositionError
from lasergym.options import LARGEST_SEED, integer_in
from lasergym.policy import Policy, PolicyName
from lasergym.targets import SIZE_PX, TargetLike, as_target

__all__ = [
    "LEARNED_PLANNERS",
    "PLANNERS",
    "Plan",
    "PlannerName",
    "ProgressCallback",
    "Score",
    "expected_error_px",
    "learned_policy",
    "plan",
    "score",
    "shortest_order",
]

PlannerName: TypeAlias = Literal[
    "raster", "raster-fine", "greedy", "policy", "agent-mpc", "anneal", "cma-es"
]
"""Names of the planners: raster scan with pitch √2 r and r, greedy, a trained policy, the same with
foresight, annealing, CMA-ES."""

PLANNERS: tuple[PlannerName, ...] = get_args(PlannerName)
"""All planners, the fastest first."""

LEARNED_PLANNERS: tuple[PlannerName, ...] = ("policy", "agent-mpc")
"""Those that need a trained policy."""

ProgressCallback: TypeAlias = Callable[[float, float], "bool | None"]
"""Called with (fraction done in [0, 1], best reward so far); returning True stops the planner."""


@dataclass(frozen=True)
class Score:
    """How well pulses machine a target.

    Attributes:
        reward: (target machined − off-target machined) / workpiece area.
        machined_fraction: Machined fraction of the target, in [0, 1].
        off_target_fraction: Area machined beside the target over the area of the target.
        pulses: Number of pulses.
    """

    reward: float
    machined_fraction: float
    off_target_fraction: float
    pulses: int

    def as_dict(self) -> dict[str, Any]:
        """The figures by name, as JSON reports hold them."""
        return asdict(self)


@dataclass(frozen=True, eq=False)
class Plan:
    """Pulses in firing order and what they achieve.

    Attributes:
        planner: Name of the planner.
        xy_px: Centres of the pulses in firing order, px; shape (pulses, 2), columns x and y.
        pulse_radius_px: Radius of every pulse, px.
        score: What the pulses achieve; its figures are attributes of the plan, too.
        elapsed_s: Time that planning took, s.
        partial: Whether the planner was stopped (by Ctrl-C or the callback) before it had finished.
    """

    planner: str
    xy_px: NDArray[np.float64]
    pulse_radius_px: float
    score: Score
    elapsed_s: float
    partial: bool

    @property
    def reward(self) -> float:
        """(target machined − off-target machined) / workpiece area."""
        return self.score.reward

    @property
    def machined_fraction(self) -> float:
        """Machined fraction of the target, in [0, 1]."""
        return self.score.machined_fraction

    @property
    def off_target_fraction(self) -> float:
        """Area machined beside the target over the area of the target."""
        return self.score.off_target_fraction

    @property
    def pulses(self) -> int:
        """Number of pulses."""
        return self.score.pulses

    @property
    def actions(self) -> NDArray[np.float32]:
        """The pulses as actions of the environments, in [-1, 1]; shape (pulses, 2).

        Stepping through them on a pristine workpiece achieves exactly what the plan says.
        """
        return (self.xy_px / (SIZE_PX / 2) - 1).astype(np.float32)

    def ordered(self, start_px: tuple[float, float] | None = None) -> Plan:
        """The same pulses in the order of shortest travel; see :func:`shortest_order`."""
        return replace(self, xy_px=self.xy_px[shortest_order(self.xy_px, start_px)])

    def as_dict(self) -> dict[str, Any]:
        """The plan as a JSON report holds it."""
        return {
            "planner": self.planner,
            **self.score.as_dict(),
            "elapsed_s": self.elapsed_s,
            "partial": self.partial,
            "pulse_radius_px": self.pulse_radius_px,
            "xy_px": self.xy_px.tolist(),
        }


def plan(
    target: TargetLike,
    planner: PlannerName = "anneal",
    *,
    max_pulses: int = 45,
    pulse_radius_px: float = 9.0,
    seed: int = 0,
    budget_s: float | None = None,
    iterations: int | None = None,
    threads: int = 1,
    restarts: int = 1,
    start: ArrayLike | None = None,
    forbidden: NDArray[np.bool_] | None = None,
    policy: Policy | PolicyName | str | Path | None = None,
    pointing_error_px: float = 0.0,
    progress: ProgressCallback | None = None,
) -> Plan:
    """Plans pulses for a target.

    Args:
        target: A Boolean array of shape (100, 100) or the name of a PNG, JPEG, SVG or DXF file.
        planner: ``"raster"`` (grid of pitch √2 r), ``"raster-fine"`` (grid of pitch r),
            ``"greedy"`` (each pulse where it gains most, refined below the pixel), ``"policy"`` (a
            trained policy), ``"agent-mpc"`` (a trained policy that refines the rest of its plan
            before each pulse), ``"anneal"`` (all pulses together, the best there is) or
            ``"cma-es"`` (the optimiser of Xie et al.).
        max_pulses: Most pulses that may be used, from 1 to 10 000. Raster scans use as many as
            their grid has cells.
        pulse_radius_px: Radius of the disc that one pulse machines, px, in (0, 50].
        seed: Seed of ``"agent-mpc"``, ``"anneal"`` and ``"cma-es"``, from 0 to 2⁶⁴ − 1.
        budget_s: Time for ``"anneal"`` (default 1 s) and ``"cma-es"`` (default 30 s), s; for each
            pulse of ``"agent-mpc"`` (default 0.02 s).
        iterations: Instead of the time, the work: Metropolis moves of each restart of ``"anneal"``,
            moves before each pulse of ``"agent-mpc"``, evaluations of ``"cma-es"``. Then the same
            seed gives the same plan on every machine.
        threads: Threads for ``"anneal"`` and ``"cma-es"``.
        restarts: Independent runs of ``"anneal"``, of which the best counts.
        start: Pulses for ``"anneal"`` to start from, px, shape (pulses, 2); it ends no worse.
        forbidden: Pristine pixels that must stay, where the workpiece is partly machined already;
            then ``target`` is what remains, and all other pixels are free. Default: all pixels
            beside the target.
        policy: The policy of ``"policy"`` and ``"agent-mpc"``, the name of a shipped one
            (:data:`lasergym.policy.SHIPPED_POLICIES`) or of a file. Default: ``"random-shape"``.
        pointing_error_px: Standard deviation along each axis by which pulses miss their aim, px, in
            [0, 8]: ``"agent-mpc"`` plans on the gain that is expected then.
        progress: Called now and then with (fraction done, best reward); returning True stops the
            planner.

    Returns:
        The plan. After Ctrl-C, or when ``progress`` stops the planner, the best plan so far, with
        ``partial`` set.

    Raises:
        OptionError: An option is outside its range.
        TargetError: The target is empty, full or of the wrong shape.
        DrawingError: The drawing cannot be read.
        PolicyError: The policy cannot be read.
    """
    remaining = as_target(target)
    learned = learned_policy(planner, policy)
    settings = {
        "planner": planner,
        "pulse_radius_px": pulse_radius_px,
        "max_pulses": integer_in("max_pulses", max_pulses, 1, 10_000),
        "seed": integer_in("seed", seed, 0, LARGEST_SEED),
        "budget_s": budget_s,
        "iterations": None
        if iterations is None
        else integer_in("iterations", iterations, 1, 2**63 - 1),
        "threads": integer_in("threads", threads, 1, 1024),
        "restarts": integer_in("restarts", restarts, 1, 10_000),
        "start": None if start is None else positions(start),
        "policy": None if learned is None else learned.native,
        "pointing_error_px": expected_error_px(planner, pointing_error_px),
    }
    started_s = time.perf_counter()
    xy_px, reward, machined_fraction, off_target_fraction, partial = _native.plan(
        remaining, None if forbidden is None else as_target(forbidden), settings, progress
    )
    elapsed_s = time.perf_counter() - started_s
    figures = Score(reward, machined_fraction, off_target_fraction, len(xy_px))
    return Plan(planner, xy_px, pulse_radius_px, figures, elapsed_s, partial)


def learned_policy(planner: str, policy: Policy | PolicyName | str | Path | None) -> Policy | None:
    """The policy that a planner uses.

    Args:
        planner: Name of the planner.
        policy: A policy, the name of a shipped one or of a file. None: ``"random-shape"`` for
            planners that need one.

    Returns:
        The policy; None for planners without one.

    Raises:
        OptionError: The planner takes no policy.
        PolicyError: The policy cannot be read.
    """
    if planner in LEARNED_PLANNERS:
        return policy if isinstance(policy, Policy) else Policy.load(policy or "random-shape")
    if policy is not None:
        raise OptionError(f"policy is {policy}, but only {' and '.join(LEARNED_PLANNERS)} take one")
    return None


def expected_error_px(planner: str, pointing_error_px: float) -> float:
    """The pointing error that a planner expects, px.

    Raises:
        OptionError: The planner takes none.
    """
    if pointing_error_px != 0 and planner != "agent-mpc":
        raise OptionError(
            f"pointing_error_px is {pointing_error_px}, but only agent-mpc expects an error"
        )
    return pointing_error_px


def score(target: TargetLike, xy_px: ArrayLike, pulse_radius_px: float = 9.0) -> Score:
    """Judges anyone's pulses on a pristine workpiece.

    Args:
        target: A Boolean array of shape (100, 100) or the name of a drawing.
        xy_px: Centres of the pulses, px; shape (pulses, 2), columns x (to the right) and y (down).
        pulse_radius_px: Radius of the disc that one pulse machines, px, in (0, 50].

    Returns:
        Reward, machined fraction, off-target fraction and number of pulses.

    Raises:
        PositionError: The positions have the wrong shape or are not finite.
        TargetError, OptionError: As for :func:`plan`.
    """
    return Score(*_native.score(as_target(target), positions(xy_px), pulse_radius_px))


def shortest_order(
    xy_px: ArrayLike, start_px: tuple[float, float] | None = None
) -> NDArray[np.int64]:
    """The order in which firing the pulses takes the shortest travel.

    What pulses machine does not depend on their order; the time of the stage does.

    Args:
        xy_px: Centres of the pulses, px; shape (pulses, 2).
        start_px: Where the stage comes from, (x, y), px; by default it starts at the first pulse.

    Returns:
        Indices into the pulses, shape (pulses,): ``xy_px[order]`` is the tour, which is open.
    """
    return _native.shortest_order(positions(xy_px), start_px)


def positions(xy_px: ArrayLike) -> NDArray[np.float64]:
    """Pulse positions as float64 of shape (pulses, 2); an empty list is no pulse.

    Raises:
        PositionError: They have another shape or are not numbers.
    """
    try:
        array = np.asarray(xy_px, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise PositionError(f"the positions are not numbers: {error}") from error
    if array.size == 0:
        return np.zeros((0, 2))
    if array.ndim != 2 or array.shape[1] != 2:
        raise PositionError(
            f"the positions have shape {array.shape}, but must have shape (pulses, 2), px"
        )
    return np.ascontiguousarray(array)
