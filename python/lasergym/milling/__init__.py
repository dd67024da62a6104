"""Depth milling with a laser or a waterjet: given a surface, find the passes of the beam.

Source: Bilbao-Guillerna, Axinte, Billingham and Cadot, "Waterjet and laser etching: the nonlinear
inverse problem", Royal Society Open Science 4 (2017).
"""

from lasergym.milling.passes import (
    ClosedLoop,
    MillingResult,
    Passes,
    Plant,
    ProgressCallback,
    Simulation,
    closed_loop,
    simulate,
    solve,
)
from lasergym.milling.processes import (
    PROCESSES,
    Calibration,
    FittedParameter,
    calibrate,
    profile_text,
)
from lasergym.milling.spots import (
    SPOT_PLANNERS,
    SpotPlan,
    SpotPlannerName,
    full_scale_um,
    plan_spots,
)
from lasergym.milling.surfaces import (
    HeightScale,
    Surface,
    depths,
    load_heights,
    random_relief,
)

__all__ = [
    "PROCESSES",
    "SPOT_PLANNERS",
    "Calibration",
    "ClosedLoop",
    "FittedParameter",
    "HeightScale",
    "MillingResult",
    "Passes",
    "Plant",
    "ProgressCallback",
    "Simulation",
    "SpotPlan",
    "SpotPlannerName",
    "Surface",
    "calibrate",
    "closed_loop",
    "depths",
    "full_scale_um",
    "load_heights",
    "plan_spots",
    "profile_text",
    "random_relief",
    "simulate",
    "solve",
]
