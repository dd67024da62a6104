"""The planners of Table 1: how their columns are headed, and what each of them can be told."""

from dataclasses import dataclass

__all__ = ["DEFAULT_PLANNERS", "PlannerColumn", "column_of"]


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
}

DEFAULT_PLANNERS: tuple[str, ...] = ("raster", "raster-fine", "greedy", "anneal", "cma-es")
"""The columns of Table 1 from left to right."""


def column_of(planner: str) -> PlannerColumn:
    """The column of a planner; one without an entry has its name as title and no settings."""
    return _COLUMNS.get(planner, PlannerColumn(planner))
