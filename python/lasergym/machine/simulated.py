"""The simulated machine as three drivers, to try drivers and jobs of your own without a lab."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lasergym import _native
from lasergym.machine.calibration import Calibration
from lasergym.machine.drivers.interface import Frame, StageLimits
from lasergym.machine.run import Drivers, SimulatedMachine

__all__ = ["SimulatedRig"]


class SimulatedRig:
    """A simulated machine whose devices are drivers in Python.

    It is a stage, a laser and a camera in one: pass it for each of them, or wrap it in classes that
    misbehave. Its time is virtual: nothing sleeps.
    """

    def __init__(
        self, path: str | os.PathLike[str], machine: SimulatedMachine | None = None
    ) -> None:
        """Opens the machine kept in the file ``path``, or makes ``machine`` and keeps it there."""
        file = Path(path)
        if machine is None:
            self._native = _native.Rig.open(file)
        else:
            options = json.dumps(machine.options())
            self._native = _native.Rig.create(file, options, machine.seed)

    def drivers(self, calibration: Calibration | None = None) -> Drivers:
        """The three drivers, calibrated on another workpiece where no calibration is given."""
        state = json.loads(self._native.state())
        made = calibration or Calibration.of_simulated(state["options"], state["seed"])
        return Drivers(self, self, self, made)

    def true_marks(self) -> NDArray[np.float64]:
        """What has really been machined: x, y and radius, px; shape (marks, 3)."""
        return self._native.true_marks()

    def limits_um(self) -> StageLimits:
        """Where the stage can go, µm."""
        return StageLimits(*self._native.limits_um())

    def move_to(self, x_um: float, y_um: float) -> None:
        """Goes to a position, µm."""
        self._native.move_to(x_um, y_um)

    def position_um(self) -> tuple[float, float]:
        """Where the encoders say that the stage is, µm."""
        return self._native.position_um()

    def home(self) -> None:
        """Goes to the upper left corner of the pattern."""
        self._native.home()

    def stop(self) -> None:
        """Does nothing: the stage never moves between calls."""
        self._native.stop()

    def arm(self) -> None:
        """Makes the laser ready to fire."""
        self._native.arm()

    def fire(self) -> None:
        """Fires one pulse."""
        self._native.fire()

    def disarm(self) -> None:
        """Makes the laser safe."""
        self._native.disarm()

    def set_exposure_s(self, exposure_s: float) -> None:
        """Sets the exposure time, s."""
        self._native.set_exposure_s(exposure_s)

    def frame(self) -> Frame:
        """A frame."""
        taken_at_s = time.monotonic()
        return Frame(self._native.frame(), taken_at_s)
