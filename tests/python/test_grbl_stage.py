"""The GRBL stage, against a controller of our own on a pseudo-terminal."""

import sys
import time
from collections.abc import Iterator

import pytest

pytest.importorskip("pty", reason="needs pseudo-terminals")
serial = pytest.importorskip("serial", reason="needs pyserial")

from grbl_simulator import GrblSimulator, Mischief  # noqa: E402
from lasergym.errors import (  # noqa: E402
    DisconnectedError,
    DriverError,
    DriverTimeoutError,
    InterlockError,
    MissingExtraError,
    OptionError,
    OutOfLimitsError,
    ProtocolError,
)
from lasergym.machine.drivers import GrblStage, Stage  # noqa: E402

ORIGIN_MM = (-5.0, -5.0)
TRAVEL_MM = ((-6.0, -6.0), (-4.0, -4.0))


@pytest.fixture
def controller() -> Iterator[GrblSimulator]:
    with GrblSimulator() as simulator:
        yield simulator


def connected(controller: GrblSimulator, **options: float) -> GrblStage:
    return GrblStage(
        controller.port,
        origin_mm=ORIGIN_MM,
        travel_mm=TRAVEL_MM,
        **{"feed_mm_min": 3000.0, "settling_s": 0.0, "answer_s": 0.5, **options},  # type: ignore[arg-type]
    )


def test_it_is_a_stage(controller: GrblSimulator) -> None:
    assert isinstance(connected(controller), Stage)


def test_it_goes_where_it_is_told(controller: GrblSimulator) -> None:
    stage = connected(controller)
    for x_um, y_um in [(50.0, 50.0), (12.5, 99.0), (-500.0, 700.0)]:
        stage.move_to(x_um, y_um)
        # x grows with the machine's, y against it; a report is rounded to 1 µm.
        assert controller.position_mm == pytest.approx((-5 + x_um / 1e3, -5 - y_um / 1e3), abs=1e-9)
        assert stage.position_um() == pytest.approx((x_um, y_um), abs=0.51)


def test_a_move_returns_when_it_has_ended(controller: GrblSimulator) -> None:
    stage = connected(controller, feed_mm_min=100.0)
    stage.move_to(-500.0, 0.0)
    began_s = time.monotonic()
    stage.move_to(0.0, 0.0)  # 0.5 mm at 100 mm/min
    assert time.monotonic() - began_s >= 0.29
    assert controller.state == "Idle"


def test_limits_are_those_of_the_travel(controller: GrblSimulator) -> None:
    limits = connected(controller).limits_um()
    assert limits.least_um == pytest.approx((-1000.0, -1000.0))
    assert limits.most_um == pytest.approx((1000.0, 1000.0))


@pytest.mark.parametrize("x_um", [1000.1, float("nan"), float("inf")])
def test_what_is_beyond_the_travel_is_never_commanded(
    controller: GrblSimulator, x_um: float
) -> None:
    stage = connected(controller)
    sent = len(controller.lines)
    with pytest.raises(OutOfLimitsError):
        stage.move_to(x_um, 0.0)
    assert len(controller.lines) == sent


def test_homing_unlocks_the_controller() -> None:
    with GrblSimulator(homing=True) as controller:
        stage = connected(controller)
        for locked in (stage.position_um, lambda: stage.move_to(10.0, 10.0)):
            with pytest.raises(DriverError, match="alarm"):
                locked()
        stage.home()
        stage.move_to(10.0, 10.0)


def test_work_coordinates_are_turned_into_machine_coordinates(controller: GrblSimulator) -> None:
    controller.mischief.work_position = True
    stage = connected(controller)
    stage.move_to(20.0, 30.0)
    assert stage.position_um() == pytest.approx((20.0, 30.0), abs=0.51)


def test_a_limit_switch_during_a_move_is_out_of_limits(controller: GrblSimulator) -> None:
    stage = connected(controller, feed_mm_min=300.0)
    controller.mischief.alarm_on_move = 1
    with pytest.raises(OutOfLimitsError, match="alarm 1"):
        stage.move_to(900.0, 900.0)
    with pytest.raises(DriverError, match="alarm"):
        stage.position_um()


def test_soft_limits_of_the_controller_are_out_of_limits() -> None:
    with GrblSimulator(travel_mm=(-5.5, 0.0)) as controller:
        stage = connected(controller)
        with pytest.raises(OutOfLimitsError, match="alarm 2"):
            stage.move_to(0.0, 900.0)


def test_another_alarm_is_a_fault(controller: GrblSimulator) -> None:
    stage = connected(controller, feed_mm_min=300.0)
    controller.mischief.alarm_on_move = 3
    with pytest.raises(DriverError, match="alarm 3"):
        stage.move_to(900.0, 900.0)


def test_an_open_door_is_an_interlock(controller: GrblSimulator) -> None:
    stage = connected(controller)
    controller.mischief.door = True
    with pytest.raises(InterlockError):
        stage.move_to(100.0, 100.0)
    with pytest.raises(InterlockError):
        stage.position_um()


def test_a_silent_controller_is_a_timeout(controller: GrblSimulator) -> None:
    stage = connected(controller, answer_s=0.1)
    controller.mischief.silent = True
    with pytest.raises(DriverTimeoutError):
        stage.position_um()
    with pytest.raises(DriverTimeoutError):
        stage.move_to(0.0, 0.0)


def test_no_controller_at_all_is_a_timeout() -> None:
    with (
        GrblSimulator(mischief=Mischief(silent=True)) as controller,
        pytest.raises(DriverTimeoutError),
    ):
        connected(controller, answer_s=0.1)


def test_a_move_that_takes_too_long_is_stopped(controller: GrblSimulator) -> None:
    stage = connected(controller, feed_mm_min=10.0, move_s=0.2)
    with pytest.raises(DriverTimeoutError):
        stage.move_to(500.0, 0.0)
    stood = controller.position_mm
    time.sleep(0.05)
    assert controller.position_mm == stood
    assert controller.state == "Idle"


def test_a_garbled_report_is_asked_for_again(controller: GrblSimulator) -> None:
    stage = connected(controller)
    stage.move_to(10.0, 20.0)
    controller.mischief.garbled_reports = 2
    assert stage.position_um() == pytest.approx((10.0, 20.0), abs=0.51)


def test_reports_that_stay_garbled_are_a_protocol_error(controller: GrblSimulator) -> None:
    stage = connected(controller)
    controller.mischief.garbled_reports = 10
    with pytest.raises(ProtocolError):
        stage.position_um()


def test_a_garbled_answer_to_a_command_is_a_protocol_error(controller: GrblSimulator) -> None:
    stage = connected(controller)
    controller.mischief.garbled_answers = 1
    with pytest.raises(ProtocolError):
        stage.move_to(10.0, 10.0)


def test_lines_without_end_are_a_protocol_error(
    controller: GrblSimulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    stage = connected(controller, answer_s=5.0)
    monkeypatch.setattr(controller, "_report", lambda: controller._say(b"\x00" * 2000))
    stage._write(b"???")
    with pytest.raises(ProtocolError, match="baud"):
        stage.position_um()


def test_stopping_keeps_the_position_known(controller: GrblSimulator) -> None:
    stage = connected(controller)
    stage._command("G53 G1 X-4.5 Y-5 F60")
    time.sleep(0.05)
    stage.stop()
    stood = controller.position_mm
    assert controller.state == "Idle"
    assert -5 < stood[0] < -4.5
    time.sleep(0.05)
    assert controller.position_mm == stood
    stage.move_to(0.0, 0.0)


def test_stopping_in_alarm_is_harmless(controller: GrblSimulator) -> None:
    stage = connected(controller)
    controller._alarm = True
    stage.stop()
    with pytest.raises(DriverError, match="alarm"):
        stage.move_to(0.0, 0.0)


def test_a_port_that_is_not_there_is_disconnected() -> None:
    with pytest.raises(DisconnectedError):
        GrblStage("/dev/no-such-port", origin_mm=ORIGIN_MM, travel_mm=TRAVEL_MM)


def test_a_cable_that_is_pulled_is_disconnected(controller: GrblSimulator) -> None:
    stage = connected(controller)
    stage.close()
    with pytest.raises(DisconnectedError):
        stage.position_um()


@pytest.mark.parametrize(
    "options",
    [
        {"sense": (1, 0)},
        {"feed_mm_min": 0.0},
        {"answer_s": float("nan")},
        {"travel_mm": ((0.0, 0.0), (-1.0, 1.0))},
    ],
)
def test_options_out_of_range_are_refused(options: dict[str, object]) -> None:
    with pytest.raises(OptionError):
        GrblStage(
            "unused",
            **{"origin_mm": ORIGIN_MM, "travel_mm": TRAVEL_MM, **options},  # type: ignore[arg-type]
        )


def test_without_pyserial_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "serial", None)
    with pytest.raises(MissingExtraError, match="pip install pyserial"):
        GrblStage("unused", origin_mm=ORIGIN_MM, travel_mm=TRAVEL_MM)
