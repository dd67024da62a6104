"""What a plan achieves, for people and for machines."""

from dataclasses import dataclass
from typing import Any

from rich.table import Table

import lasergym
from lasergym import programs
from lasergym.cli.output import table
from lasergym.planners import Plan, PlannerName
from lasergym.programs import StageDynamics, Travel
from lasergym.targets import Target

__all__ = ["PlanReport", "judge"]

_BASELINES: tuple[PlannerName, ...] = ("raster", "raster-fine", "greedy")


@dataclass(frozen=True)
class PlanReport:
    """A plan beside the simple planners' plans of the same target.

    Attributes:
        target: The target's name.
        target_px: Its area, px.
        max_pulses: The pulse budget.
        plan: The plan.
        pixel_um: Side of a pixel, µm.
        travel: How far and how long a stage travels for it.
        baselines: Raster scans, and greedy with the same budget.
    """

    target: str
    target_px: int
    max_pulses: int
    plan: Plan
    pixel_um: float
    travel: Travel
    baselines: tuple[Plan, ...]

    def as_dict(self) -> dict[str, Any]:
        """The report as JSON holds it; positions in px, lengths and times with their units."""
        plan = self.plan.as_dict()
        positions = plan.pop("xy_px")
        return {
            "target": self.target,
            "target_px": self.target_px,
            "max_pulses": self.max_pulses,
            **plan,
            "pixel_um": self.pixel_um,
            "travel_um": self.travel.length_um,
            "travel_time_s": self.travel.time_s,
            "baselines": [
                {"planner": one.planner, **one.score.as_dict(), "elapsed_s": one.elapsed_s}
                for one in self.baselines
            ],
            "version": lasergym.__version__,
            "xy_px": positions,
        }

    def table(self) -> Table:
        """The plan and its baselines, a line each."""
        made = table("planner", "reward", "machined", "off target", "pulses", "time")
        for one in (self.plan, *self.baselines):
            made.add_row(
                one.planner,
                f"{one.reward:.4f}",
                f"{one.machined_fraction:.2%}",
                f"{one.off_target_fraction:.2%}",
                str(one.pulses),
                _duration(one.elapsed_s),
            )
        return made

    def travel_line(self) -> str:
        """The travel in a line."""
        return f"travel {self.travel.length_um:.0f} µm, {self.travel.time_s:.1f} s on the stage"


def judge(
    name: str,
    target: Target,
    plan: Plan,
    *,
    max_pulses: int,
    pixel_um: float,
    dynamics: StageDynamics,
) -> PlanReport:
    """Times a plan and sets its baselines beside it.

    Args:
        name: The target's name.
        target: Boolean array of shape (100, 100).
        plan: The plan.
        max_pulses: The pulse budget it was made for.
        pixel_um: Side of a pixel, µm, above 0.
        dynamics: What the stage can do.
    """
    radius_px = plan.pulse_radius_px
    return PlanReport(
        name,
        int(target.sum()),
        max_pulses,
        plan,
        pixel_um,
        programs.travel(plan.xy_px * pixel_um, dynamics),
        tuple(
            lasergym.plan(target, planner, max_pulses=max_pulses, pulse_radius_px=radius_px)
            for planner in _BASELINES
            if planner != plan.planner
        ),
    )


def _duration(time_s: float) -> str:
    return f"{time_s * 1e3:.1f} ms" if time_s < 1 else f"{time_s:.1f} s"
