"""The planners of Table 1: how their columns are headed, and what each of them can be told."""

from collections.abc import Iterable
from dataclasses import dataclass

from lasergym.milling import SPOT_PLANNERS
from lasergym.planners import PLANNERS

__all__ = [
    "DEFAULT_PLANNERS",
    "PlannerColumn",
    "column_of",
    "default_planners",
    "planners_of",
]


@dataclass(frozen=True)
class PlannerColumn:
    """A column of the table.

    Attributes:
        title: What the column is headed with.
        in_order: Whether the order of its pulses matters; otherwise pictures join them by the way
            of shortest travel.
        seeded: Whether the planner draws random numbers and takes a seed.
        timed: Whether the planner goes on until its time is up and takes a budget, s.
    """

    title: str
    in_order: bool = True
    seeded: bool = False
    timed: bool = False


_COLUMNS = {
    "raster": PlannerColumn("raster √2r"),
    "raster-fine": PlannerColumn("raster r"),
    "greedy": PlannerColumn("greedy", in_order=False),
    "anneal": PlannerColumn("anneal", in_order=False, seeded=True, timed=True),
    "cma-es": PlannerColumn("CMA-ES", in_order=False, seeded=True, timed=True),
    "policy": PlannerColumn("policy"),
    "agent-mpc": PlannerColumn("agent-mpc", seeded=True),
    "pixel-by-pixel": PlannerColumn("pixel by pixel"),
    "adjoint": PlannerColumn("adjoint"),
}

DEFAULT_PLANNERS: tuple[str, ...] = ("raster", "raster-fine", "greedy", "anneal", "cma-es")
"""The columns of Table 1 from left to right."""


def planners_of(task: str) -> tuple[str, ...]:
    """The planners that can do a task: of spots for depth maps, of pulses for all others."""
    return SPOT_PLANNERS if task == "milling" else PLANNERS


def default_planners(tasks: Iterable[str]) -> tuple[str, ...]:
    """The columns of a comparison of these tasks, where none are asked for."""
    milling = [task == "milling" for task in tasks]
    of_pulses = () if all(milling) else DEFAULT_PLANNERS
    return (*of_pulses, *(SPOT_PLANNERS if any(milling) else ()))


def column_of(planner: str) -> PlannerColumn:
    """The column of a planner; one without an entry has its name as title and no settings."""
    return _COLUMNS.get(planner, PlannerColumn(planner))
