"""Folders of jobs that nobody has run: a plan, told as if it had been machined under a camera."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import lasergym
from lasergym.machine.journal import JOURNAL_NAME, journal_line
from lasergym.targets import Target

RADIUS_PX = 9.0
WIDTH_PX, HEIGHT_PX = 320, 240
SCALE, LEFT_PX, TOP_PX = 2.0, 60.0, 20.0
CALIBRATION = {
    "frame_width_px": WIDTH_PX,
    "frame_height_px": HEIGHT_PX,
    "frame_from_pattern": [[SCALE, 0.0, LEFT_PX], [0.0, SCALE, TOP_PX]],
    "residual_um": 0.1,
    "pairs": 25,
}
PHASES = {
    "move_s": 4.0,
    "settle_s": 2.0,
    "camera_s": 1.5,
    "vision_s": 0.04,
    "decide_s": 0.1,
    "journal_s": 0.2,
    "fire_s": 0.5,
}

REPORT_KEYS = {
    "reward",
    "machined_fraction",
    "off_target_fraction",
    "pulses",
    "elapsed_s",
    "faults",
    "resumed",
    "phases",
}
"""Keys that every report of a job has."""


def write_journal(folder: Path, records: list[Mapping[str, Any]]) -> Path:
    """Writes the journal of ``records``."""
    path = folder / JOURNAL_NAME
    crc = 0
    with path.open("wb") as file:
        for number, record in enumerate(records):
            line, crc = journal_line(number, record, crc)
            file.write(line)
    return path


def write_job(
    folder: Path,
    target: Target,
    *,
    pulses: int = 12,
    error_px: float = 0.4,
    faults: bool = True,
    ended: bool = True,
) -> NDArray[np.float64]:
    """Writes the folder of a job.

    Args:
        folder: Where; made where it is missing.
        target: What was to be machined.
        pulses: Pulses of the greedy plan to fire.
        error_px: How far the pulses land from where they are aimed, standard deviation, px.
        faults: Whether it had a fault and was resumed.
        ended: Whether it came to an end.

    Returns:
        Where the pulses landed, px; shape (pulses, 2).
    """
    (folder / "frames").mkdir(parents=True, exist_ok=True)
    aimed = lasergym.plan(target, "greedy", max_pulses=pulses).xy_px
    generator = np.random.default_rng(0)
    landed = aimed + generator.normal(0, error_px, aimed.shape)
    records: list[Mapping[str, Any]] = [
        {
            "kind": "begin",
            "version": 1,
            "target": ["".join("01"[int(pixel)] for pixel in row) for row in target],
            "pulse_radius_px": RADIUS_PX,
            "max_pulses": pulses,
            "ring_weight": 0.0,
            "dry_run": False,
            "imaging_um": [50.0, 50.0],
            "completion": 1.0,
            "planner": {"name": "greedy"},
            "drivers": {"preset": "lab"},
            "calibration": CALIBRATION,
            "seed": 7,
        }
    ]
    _keep_frame(folder, records, 0, landed[:0])
    for k, ((x_px, y_px), (seen_x_px, seen_y_px)) in enumerate(zip(aimed, landed, strict=True)):
        pulse = k + 1
        score = lasergym.score(target, landed[:pulse], RADIUS_PX)
        records += [
            {
                "kind": "intent",
                "pulse": pulse,
                "x_px": x_px,
                "y_px": y_px,
                "decided_ms": 0.2,
                "origin": "decided",
            },
            {
                "kind": "position",
                "pulse": pulse,
                "x_um": x_px,
                "y_um": y_px,
                "within_tolerance": True,
            },
            {"kind": "fired", "pulse": pulse},
        ]
        if faults and pulse == 3:
            records += [
                {"kind": "fault", "device": "camera", "fault": "timeout", "message": "no <frame>"},
                end_record("fault", lasergym.score(target, landed[: pulse - 1], RADIUS_PX)),
                {"kind": "resumed", "dropped_bytes": 0, "damage": None},
            ]
        _keep_frame(folder, records, pulse, landed[:pulse])
        mark = {"x_px": seen_x_px, "y_px": seen_y_px, "radius_px": RADIUS_PX, "confidence": 0.97}
        records.append(
            {
                "kind": "observed",
                "pulse": pulse,
                "verdict": "uncertain" if faults and pulse == 4 else "seen",
                "marks": [mark],
                "shift_px": [0.1, -0.2],
                "looks": 1,
                "vision_ms": 0.7,
                "gave_up": False,
                "state_hash": f"{pulse:016x}",
                "reward": score.reward,
                "machined_fraction": score.machined_fraction,
                "off_target_fraction": score.off_target_fraction,
            }
        )
    if ended:
        records.append(end_record("pulses_used", lasergym.score(target, landed, RADIUS_PX)))
    write_journal(folder, records)
    return landed


def end_record(status: str, score: lasergym.Score) -> dict[str, Any]:
    """The record of a job that ended with ``score``."""
    return {
        "kind": "end",
        "status": status,
        **score.as_dict(),
        "commands": score.pulses,
        "elapsed_s": sum(PHASES.values()),
        "phases": PHASES,
    }


def _keep_frame(
    folder: Path, records: list[Mapping[str, Any]], pulse: int, landed: NDArray[np.float64]
) -> None:
    """Draws and records the frame after ``pulse``: dark marks on bright, noisy ground."""
    rows, columns = np.mgrid[:HEIGHT_PX, :WIDTH_PX]
    x_px, y_px = (columns - LEFT_PX) / SCALE, (rows - TOP_PX) / SCALE
    gray = 170 + np.random.default_rng(pulse).normal(0, 3, (HEIGHT_PX, WIDTH_PX))
    for center_x_px, center_y_px in landed:
        inside = (x_px - center_x_px) ** 2 + (y_px - center_y_px) ** 2 <= RADIUS_PX**2
        gray[inside] -= 60 * (gray[inside] > 120)
    pixels = gray.clip(0, 255).astype(np.uint8)
    name = f"frames/{pulse:04}.png"
    (folder / name).write_bytes(gray_png(pixels))
    records.append(
        {
            "kind": "frame",
            "pulse": pulse,
            "file": name,
            "width_px": WIDTH_PX,
            "height_px": HEIGHT_PX,
            "crc": f"{zlib.crc32(pixels.tobytes()):08x}",
        }
    )


def gray_png(pixels: NDArray[np.uint8]) -> bytes:
    """Pixels of shape (height, width) as the bytes of an 8-bit grey PNG file."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        checksum = zlib.crc32(kind + content)
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", checksum)

    height_px, width_px = pixels.shape
    rows = b"".join(b"\x00" + row.tobytes() for row in pixels)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", struct.pack(">IIBBBBB", width_px, height_px, 8, 0, 0, 0, 0))
        + chunk(b"IDAT", zlib.compress(rows))
        + chunk(b"IEND", b"")
    )
