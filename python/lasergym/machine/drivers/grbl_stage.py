"""A stage behind a GRBL 1.1 controller on a serial port."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable
from typing import Protocol

from lasergym.errors import (
    DisconnectedError,
    DriverError,
    DriverTimeoutError,
    InterlockError,
    MissingExtraError,
    OptionError,
    OutOfLimitsError,
    ProtocolError,
)
from lasergym.machine.drivers.interface import StageLimits

__all__ = ["GrblStage"]

_STATUS = re.compile(r"<(?P<state>[A-Za-z]+)(?::(?P<substate>\d))?\|(?P<fields>[^<>]*)>")
_NUMBERS = re.compile(r"-?\d+(?:\.\d+)?(?:,-?\d+(?:\.\d+)?)+")

_FEED_HOLD = b"!"
_RESET = b"\x18"
_STATUS_QUERY = b"?"

_LIMIT_ALARMS = (1, 2)
"""Alarms of a limit switch, and of a target beyond the soft limits."""
_LOCKED_ERROR = 9
_TRAVEL_ERROR = 15
_STATUS_TRIES = 3
_POLL_S = 0.01
_WATCH_S = 0.1
"""Time between two looks at the state during a move, s."""


class _Line(Protocol):
    """What the stage needs of a serial port."""

    timeout: float | None

    def write(self, content: bytes, /) -> int | None: ...
    def read(self, size: int = 1, /) -> bytes: ...
    def close(self) -> None: ...


class GrblStage:
    """Moves the workpiece under a fixed laser with the first two axes of a GRBL 1.1 controller.

    Point (x, y) µm of the workpiece lies under the laser when the machine is at
    ``origin_mm + sense * (x, y) / 1000``. Positions are machine coordinates; GRBL reports them in
    steps of 1 µm, so give jobs a position tolerance of at least 1 µm.
    """

    def __init__(
        self,
        port: str,
        *,
        origin_mm: tuple[float, float],
        travel_mm: tuple[tuple[float, float], tuple[float, float]],
        sense: tuple[int, int] = (1, -1),
        feed_mm_min: float = 300.0,
        settling_s: float = 0.05,
        answer_s: float = 2.0,
        move_s: float = 30.0,
        homing_s: float = 60.0,
        baud: int = 115200,
        connect: Callable[[str, int, float], _Line] | None = None,
    ) -> None:
        """Connects to the controller; nothing moves.

        Args:
            port: Name of the serial port, such as ``/dev/ttyUSB0``.
            origin_mm: Machine x and y at which the upper left corner of the pattern lies under the
                laser, mm.
            travel_mm: Lowest and highest machine x and y that may be gone to, mm.
            sense: For x and y, 1 where machine and workpiece coordinates grow together, −1 where
                they do not.
            feed_mm_min: Feed rate of moves, mm/min.
            settling_s: Wait after a move, s.
            answer_s: Longest wait for an answer, s.
            move_s: Longest time of a move, s.
            homing_s: Longest time of homing, s.
            baud: Bits per second.
            connect: Opens the port, called with port, baud and the longest wait of a read, s; by
                default ``serial.Serial`` of pyserial.

        Raises:
            MissingExtraError: pyserial is not installed.
            DisconnectedError: There is no such port.
            DriverTimeoutError: No controller answers.
        """
        if any(one not in (-1, 1) for one in sense):
            raise OptionError(f"sense is {sense}, but must be 1 or -1 for x and for y")
        for name, value in {
            "feed_mm_min": feed_mm_min,
            "answer_s": answer_s,
            "move_s": move_s,
            "homing_s": homing_s,
        }.items():
            if not 0 < value < math.inf:
                raise OptionError(f"{name} is {value}, but must be above 0")
        self._origin_mm = origin_mm
        self._sense = sense
        self._feed_mm_min = feed_mm_min
        self._settling_s = settling_s
        self._answer_s = answer_s
        self._move_s = move_s
        self._homing_s = homing_s
        self._limits = self._limits_of(travel_mm)
        self._work_offset_mm: tuple[float, float] | None = None
        self._pending = b""
        self._line = (connect or _serial_line)(port, baud, _POLL_S)
        self._reset()

    def limits_um(self) -> StageLimits:
        """Where the stage can go, µm of the workpiece."""
        return self._limits

    def move_to(self, x_um: float, y_um: float) -> None:
        """Goes to a position, µm, and returns when it has settled there."""
        least, most = self._limits.least_um, self._limits.most_um
        if not (least[0] <= x_um <= most[0] and least[1] <= y_um <= most[1]):
            raise OutOfLimitsError(
                f"({x_um}, {y_um}) µm is beyond the travel, from {least} to {most} µm"
            )
        x_mm, y_mm = (
            origin + sense * um / 1000
            for origin, sense, um in zip(self._origin_mm, self._sense, (x_um, y_um), strict=True)
        )
        self._command(f"G21 G90 G94 G53 G1 X{x_mm:.4f} Y{y_mm:.4f} F{self._feed_mm_min:g}")
        # Right after "ok" the controller may not have begun to move. It answers a dwell once all
        # motion before it has ended.
        try:
            self._command("G4 P0.001", self._move_s, watch=True)
        except DriverTimeoutError:
            self.stop()
            raise
        state, _ = self._status()
        if state != "Idle":
            raise DriverError(f"the controller went to {state} after a move")
        time.sleep(self._settling_s)

    def position_um(self) -> tuple[float, float]:
        """Where the controller says that the stage is, µm of the workpiece: x and y."""
        _, machine_mm = self._status()
        return self._workpiece_um(machine_mm)

    def home(self) -> None:
        """Runs the homing cycle ($H)."""
        self._command("$H", self._homing_s)

    def stop(self) -> None:
        """Holds the motion, then empties the controller's queue; positions stay known."""
        self._write(_FEED_HOLD)
        deadline_s = time.monotonic() + self._answer_s
        while time.monotonic() < deadline_s:
            try:
                state, substate, _ = self._ask_status()
            except DriverError:
                break  # Whatever state it is in: the reset below stops it.
            if state != "Run" and (state, substate) != ("Hold", 1):
                break
            time.sleep(_POLL_S)
        self._reset()

    def close(self) -> None:
        """Lets the port go."""
        self._line.close()

    def _limits_of(self, travel_mm: tuple[tuple[float, float], tuple[float, float]]) -> StageLimits:
        corners = [self._workpiece_um(corner) for corner in travel_mm]
        (left, top), (right, bottom) = corners
        if not all(map(math.isfinite, (left, top, right, bottom))) or any(
            low >= high for low, high in zip(*travel_mm, strict=True)
        ):
            raise OptionError(f"travel_mm is {travel_mm}, but must be the lowest and the highest")
        return StageLimits(
            (min(left, right), min(top, bottom)), (max(left, right), max(top, bottom))
        )

    def _workpiece_um(self, machine_mm: tuple[float, float]) -> tuple[float, float]:
        x_um, y_um = (
            sense * (mm - origin) * 1000
            for origin, sense, mm in zip(self._origin_mm, self._sense, machine_mm, strict=True)
        )
        return x_um, y_um

    def _status(self) -> tuple[str, tuple[float, float]]:
        """State and machine position, mm, of a controller that is fit to move."""
        state, _, position_mm = self._ask_status()
        _raise_unfit(state)
        return state, position_mm

    def _ask_status(self) -> tuple[str, int | None, tuple[float, float]]:
        """State, substate and machine position, mm; asked again where the answer is garbled."""
        answer = ""
        for _ in range(_STATUS_TRIES):
            self._write(_STATUS_QUERY)
            deadline_s = time.monotonic() + self._answer_s
            while True:
                answer = self._read_line(deadline_s)
                self._raise_alarm(answer)
                if answer.startswith("<") or not _is_message(answer):
                    break
            status = self._parsed_status(answer)
            if status is not None:
                return status
        raise ProtocolError(f"this is no status report: {answer!r}")

    def _parsed_status(self, answer: str) -> tuple[str, int | None, tuple[float, float]] | None:
        match = _STATUS.fullmatch(answer)
        if match is None:
            return None
        fields = dict(field.split(":", 1) for field in match["fields"].split("|") if ":" in field)
        if any(
            name in fields and not _NUMBERS.fullmatch(fields[name])
            for name in ("MPos", "WPos", "WCO")
        ):
            return None
        if "WCO" in fields:
            self._work_offset_mm = _xy(fields["WCO"])
        substate = None if match["substate"] is None else int(match["substate"])
        if "MPos" in fields:
            return match["state"], substate, _xy(fields["MPos"])
        if "WPos" in fields and self._work_offset_mm is not None:
            (x, y), (dx, dy) = _xy(fields["WPos"]), self._work_offset_mm
            return match["state"], substate, (x + dx, y + dy)
        return None

    def _command(self, text: str, answer_s: float | None = None, *, watch: bool = False) -> None:
        """Sends a line and waits until the controller has accepted it.

        With ``watch`` it is asked meanwhile whether it is still in motion.
        """
        self._write(text.encode("ascii") + b"\n")
        deadline_s = time.monotonic() + (answer_s or self._answer_s)
        while True:
            answer = self._read_line(deadline_s, _WATCH_S if watch else None)
            if answer == "ok":
                return
            status = self._parsed_status(answer)
            if status is not None:
                _raise_unfit(status[0])
                if status[0] == "Hold":
                    raise DriverError("somebody holds the motion")
                continue
            self._raise_alarm(answer)
            number = _number_after("error:", answer)
            if number == _TRAVEL_ERROR:
                raise OutOfLimitsError(f"{text} is beyond the travel of the controller")
            if number == _LOCKED_ERROR:
                _raise_unfit("Alarm")
            if number is not None:
                raise DriverError(f"the controller refuses {text!r} with error {number}")
            if answer.startswith("Grbl "):
                raise DriverError("the controller has restarted: home the stage")
            if not _is_message(answer):
                raise ProtocolError(f"the controller answers {text!r} with {answer!r}")

    def _raise_alarm(self, answer: str) -> None:
        number = _number_after("ALARM:", answer)
        if number in _LIMIT_ALARMS:
            raise OutOfLimitsError(f"alarm {number}: the stage has reached a limit; home it")
        if number is not None:
            raise DriverError(f"alarm {number}: find the reason, then home the stage")

    def _reset(self) -> None:
        """Restarts the controller and waits for its greeting; what it said before is dropped."""
        self._write(_RESET)
        deadline_s = time.monotonic() + self._answer_s
        self._pending = b""
        while not self._read_line(deadline_s).startswith("Grbl "):
            pass

    def _write(self, content: bytes) -> None:
        try:
            self._line.write(content)
        except OSError as error:
            raise DisconnectedError(f"the controller is gone: {error}") from error

    def _read_line(self, deadline_s: float, watch_s: float | None = None) -> str:
        """The next line that is not empty; ``watch_s`` apart, status reports are asked for."""
        asked_s = time.monotonic()
        while True:
            line, end, rest = self._pending.partition(b"\n")
            if end:
                self._pending = rest
                text = line.strip().decode("ascii", "backslashreplace")
                if text:
                    return text
                continue
            now_s = time.monotonic()
            if now_s > deadline_s:
                raise DriverTimeoutError("the controller does not answer")
            if watch_s is not None and now_s > asked_s + watch_s:
                self._write(_STATUS_QUERY)
                asked_s = now_s
            if len(self._pending) > 4096:
                raise ProtocolError("the controller sends lines without end: check the baud rate")
            try:
                self._pending += self._line.read(256)
            except OSError as error:
                raise DisconnectedError(f"the controller is gone: {error}") from error


def _raise_unfit(state: str) -> None:
    """Raises when the controller is in a state from which it does not move."""
    if state == "Alarm":
        raise DriverError("the controller is in alarm: find the reason, then home the stage")
    if state == "Door":
        raise InterlockError("the door is open")


def _xy(text: str) -> tuple[float, float]:
    x, y, *_ = (float(number) for number in text.split(","))
    return x, y


def _number_after(start: str, answer: str) -> int | None:
    number = answer.removeprefix(start)
    return int(number) if number != answer and number.isdecimal() else None


def _is_message(answer: str) -> bool:
    """Whether a line is one that GRBL sends unasked."""
    return (
        answer == "ok"
        or (answer[0] == "[" and answer[-1] == "]")
        or (answer[0] == "<" and answer[-1] == ">")
    )


def _serial_line(port: str, baud: int, timeout_s: float) -> _Line:
    try:
        import serial  # type: ignore[import-untyped,import-not-found,unused-ignore]
    except ImportError as error:
        raise MissingExtraError("this stage needs pyserial: pip install pyserial") from error
    try:
        line: _Line = serial.Serial(port, baud, timeout=timeout_s, write_timeout=2.0)
    except OSError as error:
        raise DisconnectedError(f"{port} cannot be opened: {error}") from error
    return line
