"""Options of commands: how they are declared, and those that several commands share."""

from pathlib import Path
from typing import Annotated, Any

import typer

__all__ = [
    "PLANNERS_PANEL",
    "AnglesOption",
    "AnnealIterationsOption",
    "AnnealTimeOption",
    "CmaEsTimeOption",
    "FitOption",
    "FoldersArgument",
    "InkOption",
    "InvertOption",
    "MarginOption",
    "PointingErrorOption",
    "PolicyOption",
    "ShapesOption",
    "ThresholdOption",
    "option",
]

_DRAWING = "Drawing"
_LEARNED = "policy and agent-mpc"

PLANNERS_PANEL = "Planners"
"""Panel of what planners may spend."""


def option(*names: str, help: str, panel: str | None = None) -> Any:  # noqa: A002 - typer's word
    """An option with its help, in a panel of its command's help."""
    return typer.Option(*names, help=help, rich_help_panel=panel)


MarginOption = Annotated[
    float, option("--margin-px", help="Free border on each side, px.", panel=_DRAWING)
]
ThresholdOption = Annotated[
    float, option("--threshold", help="Ink that makes a pixel target, (0, 1].", panel=_DRAWING)
]
InkOption = Annotated[
    str, option("--ink", help="What is ink: auto, luminance or alpha.", panel=_DRAWING)
]
InvertOption = Annotated[bool, option("--invert", help="Machine what is not ink.", panel=_DRAWING)]
FitOption = Annotated[
    str, option("--fit", help="scale to the workpiece, or exact pixels.", panel=_DRAWING)
]
PolicyOption = Annotated[
    str | None,
    option(
        "--policy",
        help="star, rotated-star, random-shape, or a file. Default: random-shape.",
        panel=_LEARNED,
    ),
]
PointingErrorOption = Annotated[
    float,
    option(
        "--pointing-error-um",
        help="Standard deviation by which pulses miss, µm: agent-mpc plans on what is expected.",
        panel=_LEARNED,
    ),
]

FoldersArgument = Annotated[
    list[Path] | None,
    typer.Argument(metavar="[DIR]...", help="Folders of drawings for the task folder."),
]
AnglesOption = Annotated[int, option("--angles", help="Angles of the rotated star, from 1 to 360.")]
ShapesOption = Annotated[
    int, option("--shapes", help="Random shapes in each of the 7 area classes.")
]
AnnealTimeOption = Annotated[
    float, option("--anneal-s", help="Time of anneal on a target, s.", panel=PLANNERS_PANEL)
]
AnnealIterationsOption = Annotated[
    int | None,
    option(
        "--anneal-iterations", help="Moves of anneal instead of its time.", panel=PLANNERS_PANEL
    ),
]
CmaEsTimeOption = Annotated[
    float, option("--cma-es-s", help="Time of CMA-ES on a target, s.", panel=PLANNERS_PANEL)
]
