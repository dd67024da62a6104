"""A camera that OpenCV can open."""

from __future__ import annotations

import time
from types import ModuleType
from typing import Any

import numpy as np

from lasergym.errors import (
    DisconnectedError,
    DriverError,
    MissingExtraError,
    OptionError,
    ProtocolError,
)
from lasergym.machine.drivers.interface import Frame

__all__ = ["OpenCvCamera"]


class OpenCvCamera:
    """A camera of Video4Linux, DirectShow or whatever else OpenCV finds.

    Many cameras keep frames that nobody has asked for yet. ``stale_frames`` of them are thrown
    away before each frame, so that what is returned was exposed after the call: one more than the
    driver's buffer holds is enough.
    """

    def __init__(
        self,
        index: int | str = 0,
        *,
        width_px: int = 640,
        height_px: int = 480,
        stale_frames: int = 4,
        exposure_unit_s: float = 1e-4,
    ) -> None:
        """Opens the camera.

        Args:
            index: Number of the camera, or a file or address that OpenCV opens.
            width_px: Width of the frames, px.
            height_px: Height of the frames, px.
            stale_frames: Frames to throw away before each one, from 0 to 100.
            exposure_unit_s: What 1 means in OpenCV's exposure property, s: 100 µs with
                Video4Linux.

        Raises:
            MissingExtraError: OpenCV is not installed.
            DisconnectedError: There is no such camera.
            DriverError: The camera has no frames of these sides.
        """
        if not 0 <= stale_frames <= 100:
            raise OptionError(f"stale_frames is {stale_frames}, but must be from 0 to 100")
        if not 0 < exposure_unit_s < float("inf"):
            raise OptionError(f"exposure_unit_s is {exposure_unit_s}, but must be above 0")
        self._cv2 = _opencv()
        self._shape = (height_px, width_px)
        self._stale_frames = stale_frames
        self._exposure_unit_s = exposure_unit_s
        self._capture: Any = self._cv2.VideoCapture(index)
        if not self._capture.isOpened():
            raise DisconnectedError(f"camera {index} cannot be opened: check its cable and number")
        self._capture.set(self._cv2.CAP_PROP_FRAME_WIDTH, width_px)
        self._capture.set(self._cv2.CAP_PROP_FRAME_HEIGHT, height_px)
        try:
            self.frame()
        except ProtocolError as error:
            self.close()
            raise DriverError(f"{error}: ask for sides that the camera has") from error

    def set_exposure_s(self, exposure_s: float) -> None:
        """Sets the exposure time, s, above 0, and turns automatic exposure off."""
        if not 0 < exposure_s < float("inf"):
            raise OptionError(f"exposure_s is {exposure_s}, but must be above 0")
        # 1 is "manual" with Video4Linux; other back ends do not know the property or ignore it.
        self._capture.set(self._cv2.CAP_PROP_AUTO_EXPOSURE, 1)
        if not self._capture.set(self._cv2.CAP_PROP_EXPOSURE, exposure_s / self._exposure_unit_s):
            raise DriverError(f"the camera takes no exposure of {exposure_s} s")

    def frame(self) -> Frame:
        """A frame whose exposure began after the call."""
        for _ in range(self._stale_frames):
            self._grab()
        taken_at_s = time.monotonic()
        self._grab()
        read, picture = self._capture.retrieve()
        if not read or picture is None:
            raise DisconnectedError("the camera gave no picture")
        if picture.ndim == 3:
            picture = self._cv2.cvtColor(picture, self._cv2.COLOR_BGR2GRAY)
        if picture.shape != self._shape or picture.dtype != np.uint8:
            raise ProtocolError(
                f"the camera gave {picture.dtype} of shape {picture.shape} instead of uint8 of "
                f"shape {self._shape}"
            )
        return Frame(np.ascontiguousarray(picture), taken_at_s)

    def close(self) -> None:
        """Lets the camera go."""
        self._capture.release()

    def _grab(self) -> None:
        if not self._capture.grab():
            raise DisconnectedError("the camera gives no frames: check its cable")


def _opencv() -> ModuleType:
    try:
        import cv2  # type: ignore[import-not-found,unused-ignore]
    except ImportError as error:
        raise MissingExtraError(
            "this camera needs OpenCV: pip install opencv-python-headless"
        ) from error
    return cv2  # type: ignore[no-any-return,unused-ignore]
