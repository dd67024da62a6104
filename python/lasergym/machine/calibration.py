"""Where the camera sees the workpiece."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lasergym import _native
from lasergym.errors import CalibrationError
from lasergym.machine.drivers.interface import Camera, Laser, Stage
from lasergym.options import integer_in

__all__ = ["Calibration", "calibrate"]


@dataclass(frozen=True)
class Calibration:
    """The map from the workpiece to the camera's frames, fitted to a grid of test pulses.

    Attributes:
        content: The map as its file has it: ``frame_width_px``, ``frame_height_px``,
            ``frame_from_pattern`` (rows x and y of the frame; columns x, y of the pattern and 1),
            ``residual_um`` and ``pairs``.
    """

    content: Mapping[str, Any]

    @property
    def residual_um(self) -> float:
        """How far the test pulses are from the map, RMS in µm."""
        return float(self.content["residual_um"])

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Calibration:
        """Reads a calibration from its file.

        Raises:
            CalibrationError: The file is none.
        """
        try:
            content = json.loads(Path(path).read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise CalibrationError(f"{path} is no calibration: {error}") from error
        if not isinstance(content, dict):
            raise CalibrationError(f"{path} is no calibration")
        return cls(content)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the calibration to a file."""
        text = json.dumps(dict(self.content), indent=2) + "\n"
        Path(path).write_text(text, encoding="utf-8")

    @classmethod
    def of_simulated(cls, effects: Mapping[str, Any], seed: int) -> Calibration:
        """Calibrates a simulated machine on a workpiece that is thrown away.

        Args:
            effects: Every effect of the machine, by name.
            seed: Seed of its chance.

        Raises:
            CalibrationError: The residual is too large.
        """
        return cls(json.loads(_native.calibrate_simulator(json.dumps(dict(effects)), seed)))


def calibrate(
    stage: Stage,
    laser: Laser,
    camera: Camera,
    *,
    rough_scale_frame_px_per_um: float,
    pulse_radius_px: float = 9.0,
    side_pulses: int = 5,
    margin_um: float = 10.0,
    max_residual_um: float = 0.3,
) -> Calibration:
    """Fires a grid of test pulses on a spare piece of ground and fits the map to their marks.

    The laser is disarmed at the end and on every error.

    Args:
        stage: Moves the workpiece.
        laser: Fires; this is no dry run.
        camera: Looks.
        rough_scale_frame_px_per_um: Scale of the camera, frame px per µm, within 10 %.
        pulse_radius_px: Radius of a mark, px of the pattern (1 px = 1 µm).
        side_pulses: Test pulses along x and along y, from 2 to 15.
        margin_um: How far the outer ones are from the edge of the pattern, µm, from 0 to 45.
        max_residual_um: Largest residual that is accepted, RMS in µm.

    Raises:
        CalibrationError: A device failed, too few marks were seen, or the residual is too large.
        OptionError: An option is outside its range.
    """
    made = _native.calibrate(
        (stage, laser, camera),
        rough_scale_frame_px_per_um,
        pulse_radius_px,
        integer_in("side_pulses", side_pulses, 2, 15),
        margin_um,
        max_residual_um,
    )
    return Calibration(json.loads(made))
