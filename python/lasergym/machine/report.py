"""The report of a job: what its journal and frames say, as figures, pictures and one HTML page."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import lasergym
from lasergym import _native
from lasergym.machine.journal import (
    Begin,
    End,
    Fault,
    Fired,
    FrameTaken,
    Intent,
    Journal,
    Mark,
    Observed,
    Position,
    Resumed,
    read_journal,
)
from lasergym.machine.report_page import report_page
from lasergym.render import render_trajectory

__all__ = ["RIG_NAME", "JobReport", "Step", "read_report", "write_report"]

REPORT_FILES = ("report.html", "report.json", "job.png", "job.gif")
"""What :func:`write_report` leaves in the folder of the job."""

RIG_NAME = "rig.json"
"""Where the folder of a simulated job keeps its machine."""

_SIMULATED_PHASES = {
    "move_s": "move_s",
    "settle_s": "settle_s",
    "camera_s": "expose_s",
    "fire_s": "pulse_s",
}
"""Phases of a job whose time a simulated machine tells, and what it calls them."""

_ANIMATION_WIDTH_PX = 360
_ANIMATION_DELAY_S = 0.15


@dataclass(frozen=True)
class Step:
    """A pulse of a job.

    Attributes:
        pulse: Its number, from 1.
        aimed_px: Where it was aimed, px.
        position_um: Where the stage said that it was, µm; None where it did not come to that.
        fired: Whether the laser confirmed the pulse.
        observed: What was seen; None where the job was stopped before.
        frame: File of the frame after the pulse, relative to the folder.
    """

    pulse: int
    aimed_px: tuple[float, float]
    position_um: tuple[float, float] | None
    fired: bool
    observed: Observed | None
    frame: str | None

    @property
    def error_px(self) -> float | None:
        """Distance from where the pulse was aimed to the surest mark, px."""
        if self.observed is None or not self.observed.marks:
            return None
        mark = self.observed.marks[0]
        return math.dist(self.aimed_px, (mark.x_px, mark.y_px))


@dataclass(frozen=True, eq=False)
class JobReport:
    """What a job has achieved so far, or altogether.

    Attributes:
        folder: The folder of the job.
        begin: What the job is to do.
        status: How it ended, such as ``"complete"``; ``"unfinished"`` where it did not: it can be
            resumed.
        reward: (target machined − off-target machined) / workpiece area.
        machined_fraction: Machined fraction of the target, in [0, 1].
        off_target_fraction: Area machined beside the target over the area of the target.
        pulses: Pulses that left a mark, or may have.
        elapsed_s: Time that the job took, s, without the time between a stop and going on.
        phases: The same time by phase, s.
        faults: What went wrong, in order.
        resumed: How often the job went on after it had been stopped.
        steps: The pulses, in order.
        first_frame: File of the frame before the first pulse.
        damage: What is wrong with the journal; None where it is intact.
    """

    folder: Path
    begin: Begin
    status: str
    reward: float
    machined_fraction: float
    off_target_fraction: float
    pulses: int
    elapsed_s: float
    phases: Mapping[str, float]
    faults: tuple[Fault, ...]
    resumed: int
    steps: tuple[Step, ...]
    first_frame: str | None
    damage: str | None

    @property
    def marks(self) -> list[Mark]:
        """All marks that were seen, in order."""
        return [mark for step in self.steps for mark in _marks(step)]

    @property
    def complete(self) -> bool:
        """Whether there is nothing left to do; otherwise the job can be resumed."""
        return self.status in ("complete", "pulses_used", "nothing_to_gain")

    def as_dict(self) -> dict[str, Any]:
        """The report as JSON holds it."""
        return {
            "status": self.status,
            "reward": self.reward,
            "machined_fraction": self.machined_fraction,
            "off_target_fraction": self.off_target_fraction,
            "pulses": self.pulses,
            "max_pulses": self.begin.max_pulses,
            "elapsed_s": self.elapsed_s,
            "phases": dict(self.phases),
            "faults": [asdict(fault) for fault in self.faults],
            "resumed": self.resumed,
            "target_px": int(self.begin.target.sum()),
            "pulse_radius_px": self.begin.pulse_radius_px,
            "planner": dict(self.begin.planner),
            "drivers": dict(self.begin.drivers),
            "seed": self.begin.seed,
            "dry_run": self.begin.dry_run,
            "version": lasergym.__version__,
            "journal_damage": self.damage,
            "steps": [_step_as_dict(step) for step in self.steps],
        }

    def trajectory(self, pulses: int | None = None) -> NDArray[np.float64]:
        """Marks of the first ``pulses`` pulses, or of all: x, y, radius, px; shape (n, 3)."""
        seen = [mark for step in self.steps[:pulses] for mark in _marks(step)]
        rows = [(mark.x_px, mark.y_px, mark.radius_px) for mark in seen]
        return np.array(rows, dtype=np.float64).reshape(-1, 3)


def read_report(folder: str | os.PathLike[str]) -> JobReport:
    """Reads what a job has achieved from its journal, also while it is under way.

    Args:
        folder: The folder of the job.

    Raises:
        JournalError: There is no journal, or it does not say what the job is.
    """
    journal = read_journal(folder)
    begin = journal.begin
    frames = {frame.pulse: frame.file for frame in journal.of(FrameTaken)}
    steps = _steps(journal, frames)
    seen = journal.of(Observed)
    end = journal.end
    last: End | Observed | None = end or (seen[-1] if seen else None)
    elapsed_s, phases = _times(
        journal, Path(folder) / RIG_NAME if "preset" in begin.drivers else None
    )
    return JobReport(
        folder=Path(folder),
        begin=begin,
        status="unfinished" if end is None else end.status,
        reward=0.0 if last is None else last.reward,
        machined_fraction=0.0 if last is None else last.machined_fraction,
        off_target_fraction=0.0 if last is None else last.off_target_fraction,
        pulses=sum(bool(_marks(step)) for step in steps) if end is None else end.pulses,
        elapsed_s=elapsed_s,
        phases=phases,
        faults=tuple(journal.of(Fault)),
        resumed=len(journal.of(Resumed)),
        steps=steps,
        first_frame=frames.get(0),
        damage=journal.damage,
    )


def write_report(folder: str | os.PathLike[str]) -> JobReport:
    """Writes ``report.html``, ``report.json``, ``job.png`` and ``job.gif`` into a job's folder.

    Args:
        folder: The folder of the job.

    Returns:
        The report.

    Raises:
        JournalError: There is no journal, or it does not say what the job is.
    """
    report = read_report(folder)
    caption = (
        f"{report.pulses} pulses, {report.machined_fraction:.1%} machined, "
        f"{report.off_target_fraction:.1%} off target"
    )
    target = report.begin.target
    render_trajectory(target, report.trajectory(), report.folder / "job.png", caption=caption)
    (report.folder / "job.gif").write_bytes(_animation(report))
    text = json.dumps(report.as_dict(), indent=2) + "\n"
    (report.folder / "report.json").write_text(text, encoding="utf-8")
    (report.folder / "report.html").write_text(report_page(report), encoding="utf-8")
    return report


def _steps(journal: Journal, frames: Mapping[int, str]) -> tuple[Step, ...]:
    """The pulses; one that was decided again after a fault is taken as it was decided last."""
    intents = {intent.pulse: intent for intent in journal.of(Intent)}
    positions = {position.pulse: position for position in journal.of(Position)}
    fired = {fired.pulse for fired in journal.of(Fired)}
    observed = {seen.pulse: seen for seen in journal.of(Observed)}
    return tuple(
        Step(
            pulse=pulse,
            aimed_px=(intent.x_px, intent.y_px),
            position_um=_at(positions.get(pulse)),
            fired=pulse in fired,
            observed=observed.get(pulse),
            frame=frames.get(pulse),
        )
        for pulse, intent in sorted(intents.items())
    )


def _at(position: Position | None) -> tuple[float, float] | None:
    return None if position is None else (position.x_um, position.y_um)


def _marks(step: Step) -> tuple[Mark, ...]:
    return () if step.observed is None else step.observed.marks


def _times(journal: Journal, rig: Path | None) -> tuple[float, dict[str, float]]:
    """Time altogether and by phase, s, of every time that the job was begun or resumed.

    Simulated devices do not take the time that real ones would, but tell it.
    """
    stops = journal.of(End)
    elapsed_s = sum(stop.elapsed_s for stop in stops)
    phases: dict[str, float] = {}
    for stop in stops:
        for name, time_s in stop.phases.items():
            phases[name] = phases.get(name, 0.0) + time_s
    if rig is None or not rig.is_file():
        return elapsed_s, phases
    simulated = json.loads(rig.read_text(encoding="utf-8"))["elapsed"]
    for name, simulated_name in _SIMULATED_PHASES.items():
        elapsed_s += simulated[simulated_name] - phases.get(name, 0.0)
        phases[name] = simulated[simulated_name]
    return elapsed_s, phases


def _step_as_dict(step: Step) -> dict[str, Any]:
    seen = step.observed
    return {
        "pulse": step.pulse,
        "aimed_px": list(step.aimed_px),
        "verdict": None if seen is None else seen.verdict,
        "marks": [asdict(mark) for mark in _marks(step)],
        "error_px": step.error_px,
        "reward": None if seen is None else seen.reward,
        "machined_fraction": None if seen is None else seen.machined_fraction,
        "off_target_fraction": None if seen is None else seen.off_target_fraction,
    }


def _animation(report: JobReport) -> bytes:
    """The job pulse by pulse, as the bytes of a GIF file."""
    pictures = [
        render_trajectory(
            report.begin.target,
            report.trajectory(pulses),
            width_px=_ANIMATION_WIDTH_PX,
            legend=False,
        )
        for pulses in range(len(report.steps) + 1)
    ]
    return _native.gif(np.stack(pictures), _ANIMATION_DELAY_S)
