"""Laser machining under a camera: drivers, jobs that correct what went wrong, and their reports."""

from lasergym.machine import drivers
from lasergym.machine.calibration import Calibration, calibrate
from lasergym.machine.deciding import DECIDERS, DeciderName, Deciding
from lasergym.machine.journal import Journal, read_journal
from lasergym.machine.report import JobReport, Step, read_report, write_report
from lasergym.machine.run import (
    PRESETS,
    Drivers,
    JobCallback,
    JobOptions,
    JobProgress,
    Preset,
    SimulatedMachine,
    resume_job,
    run_job,
)
from lasergym.machine.simulated import SimulatedRig

__all__ = [
    "DECIDERS",
    "PRESETS",
    "Calibration",
    "DeciderName",
    "Deciding",
    "Drivers",
    "JobCallback",
    "JobOptions",
    "JobProgress",
    "JobReport",
    "Journal",
    "Preset",
    "SimulatedMachine",
    "SimulatedRig",
    "Step",
    "calibrate",
    "drivers",
    "read_journal",
    "read_report",
    "resume_job",
    "run_job",
    "write_report",
]
