"""Drivers: what a lab writes for its machine, and two to begin with."""

from lasergym.machine.drivers.grbl_stage import GrblStage
from lasergym.machine.drivers.interface import Camera, Frame, Laser, Stage, StageLimits
from lasergym.machine.drivers.opencv_camera import OpenCvCamera

__all__ = [
    "Camera",
    "Frame",
    "GrblStage",
    "Laser",
    "OpenCvCamera",
    "Stage",
    "StageLimits",
]
