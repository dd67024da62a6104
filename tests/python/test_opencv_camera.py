"""The OpenCV camera, against an OpenCV of our own."""

import sys
import time
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lasergym.errors import (
    DisconnectedError,
    DriverError,
    MissingExtraError,
    OptionError,
    ProtocolError,
)
from lasergym.machine.drivers import Camera, OpenCvCamera


class FakeCapture:
    """A camera that buffers frames: frame k shows the number k."""

    opened = True
    grabs = True
    shape: tuple[int, ...] = (480, 640, 3)
    settable = True

    def __init__(self, index: int) -> None:
        self.index = index
        self.number = 0
        self.settings: dict[int, float] = {}
        self.released = False

    def isOpened(self) -> bool:  # noqa: N802
        return self.opened

    def set(self, name: int, value: float) -> bool:
        self.settings[name] = value
        return self.settable

    def grab(self) -> bool:
        self.number += 1
        return self.grabs

    def retrieve(self) -> tuple[bool, Any]:
        return True, np.full(self.shape, self.number, np.uint8)

    def release(self) -> None:
        self.released = True


@pytest.fixture
def capture(monkeypatch: pytest.MonkeyPatch) -> type[FakeCapture]:
    class Capture(FakeCapture):
        pass

    opencv = SimpleNamespace(
        VideoCapture=Capture,
        CAP_PROP_FRAME_WIDTH=3,
        CAP_PROP_FRAME_HEIGHT=4,
        CAP_PROP_EXPOSURE=15,
        CAP_PROP_AUTO_EXPOSURE=21,
        COLOR_BGR2GRAY=6,
        cvtColor=lambda picture, _: picture[..., 0],
    )
    monkeypatch.setitem(sys.modules, "cv2", opencv)
    return Capture


@pytest.mark.usefixtures("capture")
def test_a_frame_was_taken_after_it_was_asked_for() -> None:
    camera = OpenCvCamera(0, stale_frames=3)
    assert isinstance(camera, Camera)
    before_s = time.monotonic()
    frame = camera.frame()
    assert frame.gray.shape == (480, 640)
    assert frame.gray.dtype == np.uint8
    assert (frame.gray == 8).all()  # 4 when it was opened, 3 stale ones, then this one
    assert before_s <= frame.taken_at_s <= time.monotonic()
    camera.close()
    assert camera._capture.released


@pytest.mark.usefixtures("capture")
def test_the_exposure_is_set_in_the_unit_of_the_camera() -> None:
    camera = OpenCvCamera(0)
    camera.set_exposure_s(0.01)
    assert camera._capture.settings[15] == pytest.approx(100)


def test_a_camera_without_exposure_says_so(capture: type[FakeCapture]) -> None:
    camera = OpenCvCamera(0)
    capture.settable = False
    with pytest.raises(DriverError, match="exposure"):
        camera.set_exposure_s(0.01)
    with pytest.raises(OptionError):
        camera.set_exposure_s(float("nan"))


def test_a_camera_that_is_not_there_is_disconnected(capture: type[FakeCapture]) -> None:
    capture.opened = False
    with pytest.raises(DisconnectedError):
        OpenCvCamera(7)


def test_a_camera_that_goes_is_disconnected(capture: type[FakeCapture]) -> None:
    camera = OpenCvCamera(0)
    capture.grabs = False
    with pytest.raises(DisconnectedError):
        camera.frame()


def test_other_sides_are_refused_at_once_and_later(capture: type[FakeCapture]) -> None:
    camera = OpenCvCamera(0)
    capture.shape = (240, 320)
    with pytest.raises(ProtocolError, match="shape"):
        camera.frame()
    with pytest.raises(DriverError, match="sides"):
        OpenCvCamera(0)


def test_without_opencv_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(MissingExtraError, match="pip install opencv"):
        OpenCvCamera(0)
