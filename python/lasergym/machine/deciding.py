"""Who decides the pulses of a job."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lasergym.errors import OptionError
from lasergym.options import LARGEST_SEED, integer_in
from lasergym.planners import Plan, expected_error_px, learned_policy, positions
from lasergym.policy import Policy, PolicyName

__all__ = ["DECIDERS", "DeciderName", "Deciding"]

DeciderName: TypeAlias = Literal["greedy", "policy", "agent-mpc", "anneal", "fixed"]
"""Who decides each pulse: planners that see what the last one did, or a plan as it stands."""

DECIDERS: tuple[DeciderName, ...] = get_args(DeciderName)


@dataclass(frozen=True, kw_only=True, eq=False)
class Deciding:
    """Who decides the pulses.

    Attributes:
        planner: ``"greedy"``, ``"anneal"`` (plans all pulses, then refines the rest before each),
            ``"policy"``, ``"agent-mpc"`` (a policy with foresight), or ``"fixed"``.
        policy: The policy of ``"policy"`` and ``"agent-mpc"``, the name of a shipped one
            (:data:`lasergym.policy.SHIPPED_POLICIES`) or of a file. Default: ``"random-shape"``.
        plan: Positions for ``"fixed"``, px, shape (pulses, 2), or a plan: they are fired as they
            are, whatever happens.
        seed: Seed of ``"anneal"`` and ``"agent-mpc"``, from 0 to 2⁶⁴ − 1.
        first_s: Time for the first plan of ``"anneal"``, s.
        thinking_s: Time before each pulse of ``"anneal"`` and ``"agent-mpc"``, s.
        first_iterations: Metropolis moves of the first plan, instead of its time.
        moves: Metropolis moves before each pulse, instead of their time. With both the same seed
            decides the same on every machine.
        pointing_error_px: Standard deviation along each axis by which pulses are known to miss
            their aim, px, in [0, 8]: ``"agent-mpc"`` plans on the gain that is expected then.
    """

    planner: DeciderName = "anneal"
    policy: Policy | PolicyName | str | Path | None = None
    plan: Plan | ArrayLike | None = None
    seed: int = 0
    first_s: float = 1.0
    thinking_s: float = 0.05
    first_iterations: int | None = None
    moves: int | None = None
    pointing_error_px: float = 0.0

    def settings(self) -> dict[str, Any]:
        """The settings as the native job takes them."""
        if self.planner not in DECIDERS:
            raise OptionError(f"planner is {self.planner!r}, but must be one of {DECIDERS}")
        policy = learned_policy(self.planner, self.policy)
        if (self.planner == "fixed") != (self.plan is not None):
            raise OptionError("a plan is for the planner 'fixed', which needs one")
        return {
            "name": self.planner,
            "seed": integer_in("seed", self.seed, 0, LARGEST_SEED),
            "first_iterations": self.first_iterations,
            "first_s": self.first_s,
            "moves": self.moves,
            "thinking_s": self.thinking_s,
            "policy": None if policy is None else policy.native,
            "xy_px": self._positions(),
            "pointing_error_px": expected_error_px(self.planner, self.pointing_error_px),
        }

    def written(self) -> dict[str, Any]:
        """The settings as the journal has them."""
        settings = self.settings()
        xy_px = settings.pop("xy_px")
        settings["policy"] = str(self.policy) if isinstance(self.policy, str | Path) else None
        settings["xy_px"] = None if xy_px is None else xy_px.tolist()
        return {name: value for name, value in settings.items() if value is not None}

    @classmethod
    def of(cls, written: Mapping[str, Any], policy: Policy | str | Path | None) -> Deciding:
        """The settings that a journal has."""
        values = dict(written)
        return cls(
            planner=values.pop("name"),
            policy=policy or values.pop("policy", None),
            plan=values.pop("xy_px", None),
            **{name: value for name, value in values.items() if name in cls.__dataclass_fields__},
        )

    def _positions(self) -> NDArray[np.float64] | None:
        if self.plan is None:
            return None
        return positions(self.plan.xy_px if isinstance(self.plan, Plan) else self.plan)
