"""Self-correction: what deciding pulse by pulse is worth when pulses land where they should not."""

from lasergym.disturbances.figures import draw_figures
from lasergym.disturbances.study import Study, StudyOptions, run_study
from lasergym.disturbances.trials import Trial, TrialResult

__all__ = [
    "Study",
    "StudyOptions",
    "Trial",
    "TrialResult",
    "draw_figures",
    "run_study",
]
