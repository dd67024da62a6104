"""Running jobs: with the simulated machine, or with drivers of your own."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

from lasergym import _native
from lasergym.errors import JobError, OptionError
from lasergym.machine.calibration import Calibration
from lasergym.machine.deciding import Deciding
from lasergym.machine.drivers.interface import Camera, Laser, Stage
from lasergym.machine.journal import JOURNAL_NAME, Begin, Mark, Verdict, read_journal
from lasergym.machine.report import RIG_NAME, JobReport, write_report
from lasergym.options import LARGEST_SEED, integer_in
from lasergym.policy import Policy
from lasergym.targets import TargetLike, as_target

__all__ = [
    "PRESETS",
    "Drivers",
    "JobCallback",
    "JobOptions",
    "JobProgress",
    "Preset",
    "SimulatedMachine",
    "resume_job",
    "run_job",
]

Preset: TypeAlias = Literal["ideal", "lab", "harsh"]
"""Ready-made simulated machines: without error, the rig of Xie et al. (2022), a worn one."""

PRESETS: tuple[Preset, ...] = get_args(Preset)


@dataclass(frozen=True, kw_only=True)
class SimulatedMachine:
    """A machine that is not there.

    Attributes:
        preset: Which one.
        effects: Its errors that are to be others than the preset's, by name, such as
            ``{"backlash_um": 2.0}``, which :meth:`options` lists.
        seed: Seed of all that is random in it, from 0 to 2⁶⁴ − 1.
    """

    preset: Preset = "lab"
    effects: Mapping[str, float] = field(default_factory=dict)
    seed: int = 0

    def options(self) -> dict[str, Any]:
        """Every effect of the machine, by name."""
        known: dict[str, Any] = json.loads(_native.simulator_options(self.preset))
        unknown = set(self.effects) - set(known)
        if unknown:
            raise OptionError(
                f"there is no effect {', '.join(sorted(unknown))}: use some of {', '.join(known)}"
            )
        return known | dict(self.effects)


@dataclass(frozen=True, eq=False)
class Drivers:
    """A machine that is there.

    Attributes:
        stage: Moves the workpiece.
        laser: Fires.
        camera: Looks.
        calibration: Where the camera sees the workpiece.
    """

    stage: Stage
    laser: Laser
    camera: Camera
    calibration: Calibration

    def __post_init__(self) -> None:
        """Refuses objects that are no drivers, before anything moves."""
        for name, kind in (("stage", Stage), ("laser", Laser), ("camera", Camera)):
            driver = getattr(self, name)
            if not isinstance(driver, kind):
                raise OptionError(f"{driver!r} lacks methods of a {name}: see lasergym.machine")

    def named(self) -> dict[str, str]:
        """The classes of the drivers."""
        return {
            name: type(getattr(self, name)).__qualname__ for name in ("stage", "laser", "camera")
        }


@dataclass(frozen=True, kw_only=True)
class JobOptions:
    """How a job is done.

    Attributes:
        max_pulses: Most pulses that may be used.
        pulse_radius_px: Radius of the mark that a pulse is expected to make, px, in (0, 50].
        completion: Machined fraction of the target at which the job is complete, in (0, 1].
        correct_pointing: Whether the stage is sent beside the aim by as much as pulses have lately
            landed beside theirs.
        tolerance_um: How far from its goal the stage may be when the laser fires, µm.
        looks: Frames of a pulse that are looked at while it is uncertain what it did.
        exposure_s: Exposure time of the camera, s; None leaves it as it is.
        imaging_um: Where the stage is while frames are taken, µm.
        home: Whether the stage looks for its origin first.
    """

    max_pulses: int = 45
    pulse_radius_px: float = 9.0
    completion: float = 1.0
    correct_pointing: bool = True
    tolerance_um: float = 0.5
    looks: int = 3
    exposure_s: float | None = None
    imaging_um: tuple[float, float] = (50.0, 50.0)
    home: bool = True


_KEPT_OPTIONS = ("tolerance_um", "looks", "exposure_s", "home")
"""Options that the journal keeps beside the drivers."""


@dataclass(frozen=True)
class JobProgress:
    """A job after one more pulse was commanded.

    Attributes:
        pulse: The command, from 1.
        pulses: Pulses that left a mark, or may have, so far.
        max_pulses: Most pulses of the job.
        aimed_px: Where it was aimed, px.
        verdict: What was seen.
        marks: The marks that were seen.
        reward: (target machined − off-target machined) / workpiece area, so far.
        machined_fraction: Machined fraction of the target so far, in [0, 1].
        off_target_fraction: Area machined beside the target over the area of the target, so far.
    """

    pulse: int
    pulses: int
    max_pulses: int
    aimed_px: tuple[float, float]
    verdict: Verdict
    marks: tuple[Mark, ...]
    reward: float
    machined_fraction: float
    off_target_fraction: float


JobCallback: TypeAlias = Callable[[JobProgress], "bool | None"]
"""Called after each pulse; returning True stops the job, which can then be resumed."""


def run_job(
    target: TargetLike,
    folder: str | os.PathLike[str],
    machine: SimulatedMachine | Drivers | None = None,
    *,
    deciding: Deciding | None = None,
    options: JobOptions | None = None,
    arm: bool = False,
    progress: JobCallback | None = None,
) -> JobReport:
    """Machines a target pulse by pulse, looking after each what it has really done.

    Whatever happens, the laser is off and the stage stopped in the end, and the folder holds all
    that was done. Ctrl-C stops the job; :func:`resume_job` goes on.

    Args:
        target: A Boolean array of shape (100, 100) or the name of a drawing.
        folder: A new folder for journal, frames and report.
        machine: The simulated machine (by default of the preset ``"lab"``), or drivers.
        deciding: Who decides the pulses.
        options: How the job is done.
        arm: Whether drivers may fire. By default a job with them is a dry run: everything is done
            but arming and firing. A simulated machine always fires.
        progress: Called after each pulse.

    Returns:
        The report, which is also in the folder.

    Raises:
        JobError: The folder holds a job already.
        OptionError, TargetError, CalibrationError: Something does not fit.
        JobFailedError: The journal cannot be written.
    """
    machine = SimulatedMachine() if machine is None else machine
    options = options or JobOptions()
    deciding = deciding or Deciding()
    pattern = as_target(target)
    path = Path(folder)
    if (path / JOURNAL_NAME).exists():
        raise JobError(f"{path} holds a job already: resume it, or give another folder")
    settings = {
        "target": pattern,
        "planner": json.dumps(deciding.written()),
        "decider": deciding.settings(),
        "dry_run": isinstance(machine, Drivers) and not arm,
    }
    if isinstance(machine, Drivers):
        calibration = machine.calibration
        described: dict[str, Any] = machine.named()
        seed = deciding.seed
    else:
        calibration = Calibration.of_simulated(machine.options(), machine.seed)
        described = {"preset": machine.preset, **machine.effects}
        seed = integer_in("seed", machine.seed, 0, LARGEST_SEED)
    described["options"] = {name: getattr(options, name) for name in _KEPT_OPTIONS}
    settings |= {"drivers": json.dumps(described), "seed": seed}
    path.mkdir(parents=True, exist_ok=True)
    given: _native.Rig | Drivers
    if isinstance(machine, Drivers):
        given = machine
    else:
        given = _native.Rig.create(path / RIG_NAME, json.dumps(machine.options()), seed)
    return _run(path, settings, options, calibration, given, progress)


def resume_job(
    folder: str | os.PathLike[str],
    machine: Drivers | None = None,
    *,
    policy: Policy | str | Path | None = None,
    arm: bool = False,
    progress: JobCallback | None = None,
) -> JobReport:
    """Goes on with a job that was stopped, by whatever: no pulse is lost, none fired twice.

    A pulse of unknown outcome is looked at before anything else happens.

    Args:
        folder: The folder of the job.
        machine: The drivers; None for a simulated machine, which the folder holds.
        policy: The policy, where it is no longer in the file that the job began with.
        arm: Whether drivers may fire, as the job began.
        progress: Called after each pulse.

    Returns:
        The report of the whole job. A job that has ended well is only reported.

    Raises:
        JobError: The folder holds no job, or it was begun in another way.
        JobFailedError: The journal cannot be written.
    """
    path = Path(folder)
    begin = read_journal(path).begin
    simulated = "preset" in begin.drivers
    if simulated == (machine is not None):
        raise JobError(
            f"the job in {path} was begun with {'a simulated machine' if simulated else 'drivers'}:"
            " resume it with the same"
        )
    deciding = Deciding.of(begin.planner, policy)
    settings = {
        "target": None,
        "planner": "null",
        "drivers": "null",
        "decider": deciding.settings(),
        "dry_run": not simulated and not arm,
        "seed": begin.seed,
    }
    given = machine or _native.Rig.open(path / RIG_NAME)
    calibration = Calibration(begin.calibration or {})
    return _run(path, settings, _as_begun(begin), calibration, given, progress)


def _as_begun(begin: Begin) -> JobOptions:
    return JobOptions(
        max_pulses=begin.max_pulses,
        pulse_radius_px=begin.pulse_radius_px,
        completion=begin.completion,
        correct_pointing=begin.correct_pointing,
        imaging_um=begin.imaging_um,
        **begin.drivers.get("options", {}),
    )


def _run(
    folder: Path,
    settings: dict[str, Any],
    options: JobOptions,
    calibration: Calibration,
    machine: _native.Rig | Drivers,
    progress: JobCallback | None,
) -> JobReport:
    def tell(parts: dict[str, Any]) -> bool | None:
        assert progress is not None
        marks = tuple(Mark(*mark) for mark in parts.pop("marks"))
        return progress(JobProgress(**parts, marks=marks))

    drivers = (
        (machine.stage, machine.laser, machine.camera) if isinstance(machine, Drivers) else None
    )
    _native.run_machine(
        settings
        | {
            "folder": folder,
            "calibration": json.dumps(dict(calibration.content)),
            "max_pulses": integer_in("max_pulses", options.max_pulses, 1, 10_000),
            "pulse_radius_px": options.pulse_radius_px,
            "completion": options.completion,
            "correct_pointing": options.correct_pointing,
            "tolerance_um": options.tolerance_um,
            "looks": integer_in("looks", options.looks, 1, 100),
            "exposure_s": options.exposure_s,
            "imaging_um": tuple(options.imaging_um),
            "home": options.home,
        },
        None if isinstance(machine, Drivers) else machine,
        drivers,
        None if progress is None else tell,
    )
    return write_report(folder)
