"""A GRBL 1.1 controller with two axes, on a pseudo-terminal, for the tests of the stage.

It understands ``$H``, ``$X``, G0 and G1 (with G53, X, Y and F), G4, the modal words of moves,
and the real-time commands ``?``, ``!``, ``~`` and Ctrl-X; it moves at its feed rate in real time.
"""

from __future__ import annotations

import os
import pty
import re
import select
import threading
import time
import tty
from dataclasses import dataclass, field

GREETING = b"Grbl 1.1h ['$' for help]\r\n"
_WORD = re.compile(r"([A-Z])(-?\d+(?:\.\d+)?)")


@dataclass
class Mischief:
    """What the controller does wrong from now on.

    Attributes:
        silent: It says nothing.
        garbled_reports: The next status reports that arrive damaged.
        garbled_answers: The next answers to lines that arrive damaged.
        alarm_on_move: The next move ends in this alarm halfway.
        door: The door is open: moves do not end.
        work_position: Reports have WPos and, now and then, WCO instead of MPos.
    """

    silent: bool = False
    garbled_reports: int = 0
    garbled_answers: int = 0
    alarm_on_move: int | None = None
    door: bool = False
    work_position: bool = False


@dataclass
class GrblSimulator:
    """The controller; use it as a context manager.

    Attributes:
        travel_mm: Lowest and highest machine coordinate of both axes; moves beyond are alarm 2.
        start_mm: Where it is at first.
        homing: Whether it begins in alarm and wants ``$H`` before it moves.
        mischief: What it does wrong.
        lines: Every line that it was sent.
    """

    travel_mm: tuple[float, float] = (-10.0, 0.0)
    start_mm: tuple[float, float] = (-5.0, -5.0)
    homing: bool = False
    mischief: Mischief = field(default_factory=Mischief)
    lines: list[str] = field(default_factory=list)

    def __enter__(self) -> GrblSimulator:
        self._master, slave = pty.openpty()
        tty.setraw(self._master)
        tty.setraw(slave)
        self._slave = slave
        self.port = os.ttyname(slave)
        self._stopped = threading.Event()
        self._input = b""
        self._reports = 0
        self._from_mm = self._to_mm = self.start_mm
        self._began_s = self._takes_s = 0.0
        self._held: tuple[float, float] | None = None
        self._alarm = self.homing
        self._waiting_dwell = False
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopped.set()
        self._thread.join()
        os.close(self._slave)
        os.close(self._master)

    @property
    def position_mm(self) -> tuple[float, float]:
        """Where the machine is."""
        if self._held is not None:
            return self._held
        done = 1.0
        if self._takes_s > 0:
            done = min((time.monotonic() - self._began_s) / self._takes_s, 1.0)
        (x0, y0), (x1, y1) = self._from_mm, self._to_mm
        return x0 + done * (x1 - x0), y0 + done * (y1 - y0)

    @property
    def state(self) -> str:
        """The state as a report names it."""
        if self._alarm:
            return "Alarm"
        if self.mischief.door:
            return "Door:1"
        if self._held is not None:
            return "Hold:0"
        return "Run" if self._moving else "Idle"

    @property
    def _moving(self) -> bool:
        return time.monotonic() < self._began_s + self._takes_s

    def _serve(self) -> None:
        while not self._stopped.is_set():
            readable, _, _ = select.select([self._master], [], [], 0.002)
            if readable:
                for byte in os.read(self._master, 256):
                    self._receive(bytes([byte]))
            self._progress()

    def _progress(self) -> None:
        alarm = self.mischief.alarm_on_move
        if alarm is not None and self._moving and self._halfway:
            self.mischief.alarm_on_move = None
            self._stand_still()
            self._alarm = True
            self._waiting_dwell = False
            self._say(f"ALARM:{alarm}\r\n".encode())
        if self._waiting_dwell and self.state == "Idle":
            self._waiting_dwell = False
            self._answer(b"ok\r\n")

    @property
    def _halfway(self) -> bool:
        return time.monotonic() > self._began_s + self._takes_s / 2

    def _stand_still(self) -> None:
        self._from_mm = self._to_mm = self.position_mm
        self._takes_s = 0.0
        self._held = None

    def _receive(self, byte: bytes) -> None:
        if byte == b"?":
            self._report()
        elif byte == b"!":
            if not self._alarm:
                self._held = self.position_mm
        elif byte == b"~":
            if self._held is not None:
                self._from_mm, self._held = self._held, None
                self._began_s = time.monotonic()
        elif byte == b"\x18":
            moving = self._moving and self._held is None
            self._stand_still()
            self._waiting_dwell = False
            self._input = b""
            self._alarm = self._alarm or moving
            self._say(b"\r\n" + GREETING)
            if self._alarm:
                self._say(b"[MSG:'$H'|'$X' to unlock]\r\n")
        elif byte == b"\n":
            line, self._input = self._input.decode().strip(), b""
            self.lines.append(line)
            self._execute(line)
        else:
            self._input += byte

    def _execute(self, line: str) -> None:
        if line == "$H":
            self._alarm = False
            self._from_mm = self._to_mm = (self.travel_mm[1],) * 2
            self._takes_s = 0.0
            self._answer(b"ok\r\n")
            return
        if line == "$X":
            self._alarm = False
            self._answer(b"ok\r\n")
            return
        if line.startswith("$"):
            self._answer(b"error:3\r\n")
            return
        if self._alarm:
            self._answer(b"error:9\r\n")
            return
        words = _WORD.findall(line)
        codes = {f"{letter}{float(number):g}" for letter, number in words if letter in "GM"}
        if not words or "".join(map("".join, words)) != line.replace(" ", ""):
            self._answer(b"error:2\r\n")
        elif "G4" in codes:
            self._waiting_dwell = True
        elif codes & {"G0", "G1"}:
            self._move({letter: float(number) for letter, number in words})
        elif codes <= {"G21", "G90", "G94", "M5"}:
            self._answer(b"ok\r\n")
        else:
            self._answer(b"error:20\r\n")

    def _move(self, words: dict[str, float]) -> None:
        x, y = self.position_mm
        target = words.get("X", x), words.get("Y", y)
        low, high = self.travel_mm
        if not all(low <= value <= high for value in target):
            self._alarm = True
            self._say(b"ALARM:2\r\n")
            return
        distance_mm = ((target[0] - x) ** 2 + (target[1] - y) ** 2) ** 0.5
        self._from_mm, self._to_mm = (x, y), target
        self._began_s = time.monotonic()
        self._takes_s = distance_mm / words.get("F", 1000.0) * 60
        self._answer(b"ok\r\n")

    def _report(self) -> None:
        x, y = self.position_mm
        if self.mischief.work_position:
            # Work coordinates are off by (1, −2) mm; every third report says so.
            place = f"WPos:{x - 1:.3f},{y + 2:.3f},0.000|FS:0,0"
            if self._reports % 3 == 0:
                place += "|WCO:1.000,-2.000,0.000"
        else:
            place = f"MPos:{x:.3f},{y:.3f},0.000|FS:0,0"
        self._reports += 1
        report = f"<{self.state}|{place}>\r\n".encode()
        if self.mischief.garbled_reports > 0:
            self.mischief.garbled_reports -= 1
            report = report.replace(b":", b"\xff", 1).replace(b"0", b"")
        self._say(report)

    def _answer(self, answer: bytes) -> None:
        if self.mischief.garbled_answers > 0:
            self.mischief.garbled_answers -= 1
            answer = b"o\x80#k~\r\n"
        self._say(answer)

    def _say(self, text: bytes) -> None:
        if not self.mischief.silent:
            os.write(self._master, text)
