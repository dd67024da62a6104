"""The journal of a job: every command, observation and fault, in the order in which they happened.

``journal.jsonl`` has one record a line, ``{"n": …, "record": {"kind": …}, "crc": "8 hex digits"}``:
``n`` counts from 0, and ``crc`` is the CRC-32 of the ``crc`` of the line before and this line up to
its own. A record that was cut off or altered therefore ends the part that can be trusted.
"""

from __future__ import annotations

import dataclasses
import json
import os
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Literal, TypeAlias, TypeVar

import numpy as np

from lasergym.errors import JournalError
from lasergym.targets import SIZE_PX, Target

__all__ = [
    "JOURNAL_NAME",
    "Begin",
    "End",
    "Fault",
    "Fired",
    "FrameTaken",
    "Intent",
    "Journal",
    "Mark",
    "Observed",
    "Position",
    "Record",
    "Resumed",
    "Unknown",
    "Verdict",
    "journal_line",
    "read_journal",
]

JOURNAL_NAME = "journal.jsonl"
"""Name of the journal in the folder of its job."""

Verdict: TypeAlias = Literal["seen", "nothing", "uncertain", "dry"]
"""What looking at the workpiece after a pulse said; ``"dry"`` where the laser was not to fire."""

_Kind = TypeVar("_Kind")


@dataclass(frozen=True)
class Mark:
    """A disc that a pulse has machined.

    Attributes:
        x_px: Centre, to the right, px of the pattern (1 px = 1 µm).
        y_px: Centre, down, px.
        radius_px: Radius, px.
        confidence: How sure the vision is, in [0, 1].
    """

    x_px: float
    y_px: float
    radius_px: float
    confidence: float


@dataclass(frozen=True, eq=False)
class Begin:
    """What the job is to do.

    Attributes:
        target: Boolean array of shape (100, 100).
        pulse_radius_px: Radius of the mark that a pulse is expected to make, px.
        max_pulses: Most pulses that may be fired.
        planner: Name and settings of the planner.
        drivers: Preset of the simulator or names of the drivers.
        calibration: How the camera sees the workpiece.
        seed: Seed of planner and simulator.
        dry_run: Whether the laser is not to fire.
        completion: Machined fraction of the target at which the job is complete.
        correct_pointing: Whether the stage is sent beside the aim by as much as pulses have landed
            beside theirs.
        imaging_um: Where the stage is while frames are taken, µm.
        version: Version of the journal's format.
    """

    target: Target
    pulse_radius_px: float
    max_pulses: int
    planner: Mapping[str, Any] = field(default_factory=dict)
    drivers: Mapping[str, Any] = field(default_factory=dict)
    calibration: Mapping[str, Any] | None = None
    seed: int = 0
    dry_run: bool = False
    completion: float = 1.0
    correct_pointing: bool = False
    imaging_um: tuple[float, float] = (50.0, 50.0)
    version: int = 1

    kind: ClassVar[str] = "begin"


@dataclass(frozen=True)
class FrameTaken:
    """A frame was kept.

    Attributes:
        file: Its file, relative to the folder of the job.
        pulse: The pulse after which it was taken; 0 before the first.
    """

    file: str
    pulse: int

    kind: ClassVar[str] = "frame"


@dataclass(frozen=True)
class Intent:
    """A pulse was decided.

    Attributes:
        pulse: Number of the command, from 1; commands that leave no mark count, too.
        x_px: Where it is aimed, px.
        y_px: Where it is aimed, px.
        correction_px: How far beside its aim the stage is sent along x and y, since pulses have
            landed beside theirs, px.
        decided_ms: Time that the decision took, ms.
        origin: ``"decided"``, ``"again"`` (a command that was never carried out is repeated), or
            ``"recovered"`` (found on the workpiece when the job was resumed).
    """

    pulse: int
    x_px: float
    y_px: float
    correction_px: tuple[float, float] = (0.0, 0.0)
    decided_ms: float = 0.0
    origin: str = "decided"

    kind: ClassVar[str] = "intent"


@dataclass(frozen=True)
class Position:
    """The stage confirmed where it is, before a pulse.

    Attributes:
        pulse: Number of the pulse.
        x_um: What the encoders say, µm.
        y_um: What the encoders say, µm.
        within_tolerance: Whether that is near enough to fire.
    """

    pulse: int
    x_um: float
    y_um: float
    within_tolerance: bool = True

    kind: ClassVar[str] = "position"


@dataclass(frozen=True)
class Fired:
    """The laser confirmed a pulse.

    Attributes:
        pulse: Number of the pulse.
    """

    pulse: int

    kind: ClassVar[str] = "fired"


@dataclass(frozen=True)
class Observed:
    """What was seen after a pulse, and how the job stands since.

    Attributes:
        pulse: Number of the pulse.
        verdict: Whether marks were seen, nothing, or something uncertain.
        marks: New marks.
        reward: (target machined − off-target machined) / workpiece area, so far.
        machined_fraction: Machined fraction of the target so far, in [0, 1].
        off_target_fraction: Area machined beside the target over the area of the target, so far.
        shift_px: How far the workpiece has moved in the view since the first frame, px.
        looks: Number of frames that it took to decide.
        vision_ms: Time that the image processing took, ms.
        gave_up: Whether target was given up, since pulses there left nothing.
        state_hash: Names the state of the workpiece.
    """

    pulse: int
    verdict: Verdict
    marks: tuple[Mark, ...]
    reward: float
    machined_fraction: float
    off_target_fraction: float
    shift_px: tuple[float, float] = (0.0, 0.0)
    looks: int = 1
    vision_ms: float = 0.0
    gave_up: bool = False
    state_hash: str = ""

    kind: ClassVar[str] = "observed"


@dataclass(frozen=True)
class Fault:
    """Something went wrong.

    Attributes:
        fault: What kind of fault, such as ``"timeout"``.
        device: The device it happened to, such as ``"stage"``.
        message: What the device said.
    """

    fault: str
    device: str
    message: str

    kind: ClassVar[str] = "fault"


@dataclass(frozen=True)
class Resumed:
    """The job went on after it had been stopped.

    Attributes:
        dropped_bytes: Bytes at the end of the journal that could not be trusted.
        damage: What was wrong with them.
    """

    dropped_bytes: int = 0
    damage: str | None = None

    kind: ClassVar[str] = "resumed"


@dataclass(frozen=True)
class End:
    """The job was brought to an end or to a stop from which it can be resumed.

    Attributes:
        status: Why: ``"complete"``, ``"pulses_used"``, ``"nothing_to_gain"``, ``"commands_used"``,
            ``"interrupted"`` or ``"fault"``.
        reward: (target machined − off-target machined) / workpiece area.
        machined_fraction: Machined fraction of the target, in [0, 1].
        off_target_fraction: Area machined beside the target over the area of the target.
        pulses: Pulses that left a mark, or may have.
        elapsed_s: Time since the job was begun or resumed, s.
        phases: The same time by phase, s.
    """

    status: str
    reward: float
    machined_fraction: float
    off_target_fraction: float
    pulses: int
    elapsed_s: float
    phases: Mapping[str, float] = field(default_factory=dict)

    kind: ClassVar[str] = "end"


@dataclass(frozen=True)
class Unknown:
    """A record of another version of lasergym.

    Attributes:
        content: The record as it stands in the journal.
    """

    content: Mapping[str, Any]


Record: TypeAlias = (
    Begin | FrameTaken | Intent | Position | Fired | Observed | Fault | Resumed | End | Unknown
)


@dataclass(frozen=True, eq=False)
class Journal:
    """The part of a journal that can be trusted.

    Attributes:
        records: The records, in order.
        damage: What ends the part that can be trusted before the end of the file; None where the
            whole file is intact.
    """

    records: tuple[Record, ...]
    damage: str | None

    @property
    def begin(self) -> Begin:
        """The first record.

        Raises:
            JournalError: The job has not begun.
        """
        if not self.records or not isinstance(self.records[0], Begin):
            raise JournalError(
                f"the journal does not say what the job is: {self.damage or 'empty'}"
            )
        return self.records[0]

    @property
    def end(self) -> End | None:
        """The last record of a job that is not under way."""
        last = self.records[-1] if self.records else None
        return last if isinstance(last, End) else None

    def of(self, kind: type[_Kind]) -> list[_Kind]:
        """All records of a kind, in order."""
        return [record for record in self.records if isinstance(record, kind)]


def read_journal(path: str | os.PathLike[str]) -> Journal:
    """Reads the journal of a job as far as it is intact.

    Args:
        path: The journal, or the folder of the job.

    Raises:
        JournalError: There is no journal, or a record that is intact makes no sense.
    """
    file = Path(path)
    if file.is_dir():
        file /= JOURNAL_NAME
    try:
        content = file.read_bytes()
    except FileNotFoundError as error:
        raise JournalError(f"{file} does not exist: this is no folder of a job") from error
    records: list[Record] = []
    crc = 0
    for number, line in enumerate(content.splitlines(keepends=True)):
        checked = _checked(line, number, crc)
        if isinstance(checked, str):
            return Journal(tuple(records), f"line {number + 1} {checked}")
        fields, crc = checked
        records.append(_record(fields, number + 1))
    return Journal(tuple(records), None)


def journal_line(number: int, record: Mapping[str, Any], previous_crc: int) -> tuple[bytes, int]:
    """A line of a journal and its checksum.

    Args:
        number: Lines before it.
        record: The record, with its ``kind``.
        previous_crc: Checksum of the line before, 0 for the first.
    """
    compact = json.dumps(record, separators=(",", ":"), ensure_ascii=False)
    covered = f'{{"n":{number},"record":{compact}'.encode()
    crc = _crc_of(covered, previous_crc)
    return covered + _tail(crc), crc


def _crc_of(covered: bytes, previous_crc: int) -> int:
    return zlib.crc32(f"{previous_crc:08x}".encode() + covered)


def _tail(crc: int) -> bytes:
    return f',"crc":"{crc:08x}"}}\n'.encode()


def _checked(line: bytes, number: int, previous_crc: int) -> tuple[dict[str, Any], int] | str:
    """The record of a line and its checksum, or what is wrong with the line."""
    if not line.endswith(b"\n"):
        return "was not written to its end"
    covered = line[: -len(_tail(0))]
    crc = _crc_of(covered, previous_crc)
    if line != covered + _tail(crc):
        return "does not match its checksum"
    try:
        parsed = json.loads(line)
    except ValueError:
        return "is no JSON"
    if not isinstance(parsed, dict) or not isinstance(parsed.get("record"), dict):
        return "is no record"
    if parsed.get("n") != number:
        return f"has the number {parsed.get('n')}"
    return parsed["record"], crc


_PLAIN: tuple[type[FrameTaken | Position | Fired | Fault | Resumed | End], ...] = (
    FrameTaken,
    Position,
    Fired,
    Fault,
    Resumed,
    End,
)
"""Records whose fields stand in the journal as they are."""


def _record(fields: dict[str, Any], line: int) -> Record:
    """The typed record of a line; fields that this version does not know are left out."""
    made = dict(fields)
    kind = made.pop("kind", None)
    try:
        if kind == Begin.kind:
            x_um, y_um = made.get("imaging_um", (50.0, 50.0))
            read = {"target": _target(made["target"]), "imaging_um": (x_um, y_um)}
            return _known(Begin, made | read)
        if kind == Intent.kind:
            return _known(Intent, made | {"correction_px": _pair(made.get("correction_px"))})
        if kind == Observed.kind:
            marks = tuple(_known(Mark, mark) for mark in made["marks"])
            shift_px = _pair(made.get("shift_px"))
            return _known(Observed, made | {"marks": marks, "shift_px": shift_px})
        for plain in _PLAIN:
            if kind == plain.kind:
                return _known(plain, made)
    except (KeyError, TypeError, ValueError) as error:
        raise JournalError(
            f"line {line} of the journal, {kind}: {error!r} makes no sense"
        ) from error
    return Unknown(fields)


def _known(kind: type[_Kind], values: Mapping[str, Any]) -> _Kind:
    names = {one.name for one in dataclasses.fields(kind)}  # type: ignore[arg-type]
    return kind(**{name: value for name, value in values.items() if name in names})


def _pair(written: Any) -> tuple[float, float]:
    """Two numbers, 0 where older journals have none."""
    x, y = (0.0, 0.0) if written is None else written
    return float(x), float(y)


def _target(written: Any) -> Target:
    """A target written as 100 rows of the digits 0 and 1."""
    target = np.array([[digit == "1" for digit in row] for row in written])
    if target.shape != (SIZE_PX, SIZE_PX):
        raise ValueError(f"a target of shape {target.shape}")
    return target
