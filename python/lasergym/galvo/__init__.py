"""Scan heads: their dynamics, calibration from test lines, and the adaptive postprocessor.

Source: Penchev et al., "Beam deflectors' dynamics: adaptive postprocessor". Positions are µm with y
up, times µs, speeds m/s.
"""

from lasergym.galvo.calibration import (
    AxisCalibration,
    Calibration,
    Identification,
    MeasuredLine,
    Regression,
    calibrate,
    identify,
    line_pattern,
    measure_line,
)
from lasergym.galvo.heads import (
    HEADS,
    head_text,
)
from lasergym.galvo.programs import (
    DIALECTS,
    Compensation,
    Judgement,
    Method,
    compensation,
    postprocess,
    simulate,
)
from lasergym.galvo.tuning import (
    LineOutcomes,
    Tuning,
    machine_lines,
    tune,
)

__all__ = [
    "DIALECTS",
    "HEADS",
    "AxisCalibration",
    "Calibration",
    "Compensation",
    "Identification",
    "Judgement",
    "LineOutcomes",
    "MeasuredLine",
    "Method",
    "Regression",
    "Tuning",
    "calibrate",
    "compensation",
    "head_text",
    "identify",
    "line_pattern",
    "machine_lines",
    "measure_line",
    "postprocess",
    "simulate",
    "tune",
]
