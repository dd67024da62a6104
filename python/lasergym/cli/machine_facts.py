"""What a measurement was made on."""

import os
import platform
from pathlib import Path

import gymnasium
import numpy as np

import lasergym

__all__ = ["machine_facts", "threads_available"]


def threads_available() -> int:
    """Processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def machine_facts() -> dict[str, str | int | float]:
    """Processor, cores, load and versions."""
    facts: dict[str, str | int | float] = {
        "processor": _processor(),
        "cores": threads_available(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "gymnasium": gymnasium.__version__,
        "lasergym": lasergym.__version__,
    }
    if hasattr(os, "getloadavg"):
        facts["load_before"] = round(os.getloadavg()[0], 2)
    return facts


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    for line in lines:
        name, _, value = line.partition(":")
        if name.strip() == "model name":
            return value.strip()
    return platform.processor() or platform.machine()
