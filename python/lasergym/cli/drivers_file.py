"""Drivers that a Python file gives."""

import importlib.util
from pathlib import Path

from lasergym.errors import OptionError
from lasergym.machine import Calibration, Drivers

__all__ = ["drivers_from"]


def drivers_from(path: Path, calibration: Path) -> Drivers:
    """Runs a Python file and asks its function ``connect()`` for stage, laser and camera.

    Args:
        path: The file.
        calibration: The calibration of camera and stage.

    Raises:
        OptionError: It is no Python file, or has no such function.
        CalibrationError: The calibration cannot be read.
    """
    read = Calibration.load(calibration)
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None or not path.is_file():
        raise OptionError(f"{path} is no Python file")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    connect = getattr(module, "connect", None)
    if connect is None:
        raise OptionError(f"{path} has no function connect(), which gives stage, laser and camera")
    stage, laser, camera = connect()
    return Drivers(stage, laser, camera, read)
