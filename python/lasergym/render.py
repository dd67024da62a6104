"""Pictures of targets, pulses and depths, and the workpiece as text."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lasergym import _native
from lasergym.errors import OptionError, PositionError
from lasergym.planners import Plan, positions
from lasergym.targets import Target, TargetLike, as_target

__all__ = [
    "Trajectory",
    "ansi_frame",
    "render_trajectory",
    "residual_ansi",
    "residual_frame",
]

FRAME_WIDTH_PX = 400
"""Width and height of the frames of environments, px of the screen."""


class Trajectory:
    """A target and the pulses fired at it so far."""

    def __init__(self, target: Target, pulse_radius_px: float) -> None:
        """Begins with no pulse; ``pulse_radius_px`` is the radius of pulses without their own."""
        self.target = target
        self.pulse_radius_px = pulse_radius_px
        self.pulses: list[tuple[float, float, float]] = []

    def add(self, x_px: float, y_px: float, radius_px: float | None = None) -> None:
        """Adds a pulse at (x, y), px, with its own radius where given."""
        self.pulses.append((x_px, y_px, radius_px or self.pulse_radius_px))

    def copy(self) -> Trajectory:
        """An independent copy."""
        twin = Trajectory(self.target, self.pulse_radius_px)
        twin.pulses = list(self.pulses)
        return twin

    def rgb_array(self, width_px: int = FRAME_WIDTH_PX) -> NDArray[np.uint8]:
        """The picture without legend, uint8 of shape (width, width, 3)."""
        return self._picture(width_px, legend=False).rgb_array()

    def _picture(
        self,
        width_px: int,
        *,
        legend: bool = True,
        order_numbers: bool = False,
        caption: str | None = None,
    ) -> _native.TrajectoryPicture:
        pulses = np.array(self.pulses, dtype=np.float64).reshape(-1, 3)
        return _native.TrajectoryPicture(
            self.target, pulses, width_px, legend, order_numbers, caption
        )


def render_trajectory(
    target: TargetLike,
    pulses: Plan | ArrayLike,
    path: str | os.PathLike[str] | None = None,
    *,
    pulse_radius_px: float | None = None,
    width_px: int = 800,
    legend: bool = True,
    order_numbers: bool = False,
    caption: str | None = None,
) -> NDArray[np.uint8]:
    """Draws pulses over their target in the style of Xie et al. (2022), Fig. 2 c.

    The target is yellow, pulse centres are red dots, the path between them is coloured by order,
    and the outline of the machined area is green.

    Args:
        target: A Boolean array of shape (100, 100) or the name of a drawing.
        pulses: A plan, or centres of pulses in firing order, px; shape (pulses, 2), or (pulses, 3)
            with the radius of each.
        path: Where to write the picture, ``.png`` or ``.svg``; None only returns it.
        pulse_radius_px: Radius of pulses without their own, px; by default that of the plan, or 9.
        width_px: Width of the picture, px.
        legend: Whether to draw the colour bar, the key and the scale.
        order_numbers: Whether every pulse carries its number.
        caption: A line above the workpiece.

    Returns:
        The picture, uint8 of shape (height, width, 3).

    Raises:
        OptionError: The path has another ending, or an option is outside its range.
    """
    if isinstance(pulses, Plan):
        radius_px = pulse_radius_px or pulses.pulse_radius_px
        rows: ArrayLike = pulses.xy_px
    else:
        radius_px = pulse_radius_px or 9.0
        rows = pulses
    if not 1 <= width_px <= 8000:
        raise OptionError(f"width_px is {width_px}, but must be from 1 to 8000")
    trajectory = Trajectory(as_target(target), radius_px)
    array = np.asarray(rows, dtype=np.float64)
    if array.ndim == 2 and array.shape[1] == 3:
        if not np.isfinite(array).all():
            raise PositionError("the pulses have a position or a radius that is not finite")
        trajectory.pulses = [(x, y, r) for x, y, r in array.tolist()]
    else:
        for x_px, y_px in positions(array).tolist():
            trajectory.add(x_px, y_px)
    picture = trajectory._picture(
        width_px, legend=legend, order_numbers=order_numbers, caption=caption
    )
    if path is not None:
        file = Path(path)
        if file.suffix.lower() == ".svg":
            file.write_text(picture.svg(), encoding="utf-8")
        elif file.suffix.lower() == ".png":
            file.write_bytes(picture.png())
        else:
            raise OptionError(f"a picture is written as .png or .svg, not as {file.name!r}")
    return picture.rgb_array()


def ansi_frame(
    remaining: Target,
    forbidden: Target,
    machined_fraction: float,
    off_target_fraction: float,
    pulses: int,
) -> str:
    """The workpiece as text of 50 × 25 characters and a line of figures.

    A character stands for 2 × 4 px: ``#`` where most of it is remaining target, ``.`` where most
    must stay, a blank where most is machined.
    """
    blocks = np.stack([remaining, forbidden, ~(remaining | forbidden)])
    counts = blocks.reshape(3, 25, 4, 50, 2).sum(axis=(2, 4))
    symbols = np.array(["#", ".", " "])[counts.argmax(axis=0)]
    lines = ["".join(row) for row in symbols]
    lines.append(
        f"pulses {pulses}  machined {machined_fraction:.1%}  off-target {off_target_fraction:.1%}"
    )
    return "\n".join(lines)


def residual_frame(
    residual_um: NDArray[np.float64], full_scale_um: float, width_px: int = FRAME_WIDTH_PX
) -> NDArray[np.uint8]:
    """What is left to mill as a picture.

    White: the target is reached; blue: ``full_scale_um`` is left; red: as much too deep.

    Args:
        residual_um: Target less depth, µm; shape (n, n), where n divides ``width_px``.
        full_scale_um: Residual of the full colours, µm.
        width_px: Width and height of the picture, px.

    Returns:
        uint8 of shape (width, width, 3).
    """
    part = np.clip(residual_um / full_scale_um, -1, 1)[..., None]
    white = np.array([255.0, 255.0, 255.0])
    left, beyond = np.array([25.0, 70.0, 160.0]), np.array([190.0, 30.0, 30.0])
    # The square root makes small residuals visible.
    strength = np.sqrt(np.abs(part))
    colours = white + strength * (np.where(part > 0, left, beyond) - white)
    repeats = width_px // len(residual_um)
    picture: NDArray[np.uint8] = np.rint(colours).astype(np.uint8)
    return picture.repeat(repeats, axis=0).repeat(repeats, axis=1)


def residual_ansi(
    residual_um: NDArray[np.float64], full_scale_um: float, error_percent: float, spots: int
) -> str:
    """What is left to mill as text of 50 × 25 characters and a line of figures.

    A character stands for 2 × 4 px: ``#``, ``+``, ``-`` where more than a half, a fifth, a
    twentieth of ``full_scale_um`` is left on average, ``x`` where the ground is more than a
    twentieth too deep, a blank elsewhere.
    """
    part = residual_um.reshape(25, 4, 50, 2).mean(axis=(1, 3)) / full_scale_um
    symbols = np.select([part > 0.5, part > 0.2, part > 0.05, part < -0.05], list("#+-x"), " ")
    lines = ["".join(row) for row in symbols.tolist()]
    lines.append(f"spots {spots}  tracking error {error_percent:.2f} %")
    return "\n".join(lines)
