"""Laser machining under a camera: drivers, jobs that correct what went wrong, and their reports."""

from lasergym.machine import drivers
from lasergym.machine.journal import Journal, JournalError, read_journal
from lasergym.machine.report import JobReport, Step, read_report, write_report

__all__ = [
    "JobReport",
    "Journal",
    "JournalError",
    "Step",
    "drivers",
    "read_journal",
    "read_report",
    "write_report",
]
