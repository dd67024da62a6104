"""Tunes offsets and delays on drawn scan heads, and judges them on lines of their own.

Run ``python training/tune_heads.py``. On each head and at each speed CMA-ES searches a correction
of the formulas (``lasergym.galvo.tune``) on lines of three lengths in three directions; formulas
and correction are then judged on drawn lines that it did not see. The formulas know what a
laboratory would: of the shipped heads the head itself (the formulas fit); of the drawn ones a
calibration from four noisy test lines along x, which knows nothing of the other axis, or, where the
laser is late, a model of the mirrors alone. The cost of a line is (|start error| + |end error| +
distance beside it)/10 µm + largest |pitch - 1|/0.05 + extra time/2000 µs.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lasergym import galvo

SPEEDS_M_S = (0.5, 1.0, 1.5, 2.0)
JUDGED_LINES = 20
NOISE_UM = 1.5


@dataclass(frozen=True)
class Plant:
    """A head, and what the formulas know of it; names of TOML files or of shipped heads."""

    family: str
    head: str
    known: str


def axis(name: str, kind: str, **values: float) -> str:
    """A section of a head file."""
    lines = "".join(f"{key} = {value!r}\n" for key, value in values.items())
    return f'[{name}]\nkind = "{kind}"\n{lines}'


def resonant(lag_us: float, part: float, frequency_hz: float) -> str:
    """A step response as it is recorded from a servo whose mirror rings."""
    time_us = np.arange(0.0, 2400.0, 12.0)
    omega, damping = 1.4 / lag_us, 0.7
    beta = omega * np.sqrt(1 - damping**2)
    decay = np.exp(-damping * omega * time_us)
    step = 1 - decay * (np.cos(beta * time_us) + damping * omega / beta * np.sin(beta * time_us))
    ringing = part * np.exp(-time_us / 400.0) * np.sin(2e-6 * np.pi * frequency_hz * time_us)
    response = step + ringing * (1 - np.exp(-time_us / 100.0))
    response[-1] = 1.0
    rows = ", ".join(
        f"[{t!r}, {x!r}]" for t, x in zip(time_us.tolist(), response.tolist(), strict=True)
    )
    return f'[axis]\nkind = "step-response"\nsamples = [{rows}]\n'


def drawn_heads(generator: np.random.Generator) -> Iterator[tuple[str, str]]:
    """Families that the formulas fit badly, and the text of a head of each."""

    def between(low: float, high: float) -> float:
        return float(generator.uniform(low, high))

    yield (
        "underdamped",
        axis("axis", "second-order", lag_us=between(150, 300), damping=between(0.3, 0.5)),
    )
    yield "resonant", resonant(between(150, 300), between(0.05, 0.15), between(1000, 2500))
    sections = []
    lag_us, dead_us = between(100, 180), between(40, 120)
    for name, factor in (("x", 1.0), ("y", between(1.1, 1.4))):
        values = {"lag_us": lag_us * factor, "damping": 0.8, "dead_time_us": dead_us * factor}
        sections.append(axis(name, "second-order", **values))
    yield "unequal axes", "".join(sections)
    laser = f"[laser]\nresponse_us = {between(5, 40)!r}\n"
    yield "late laser", axis("axis", "bessel", lag_us=between(150, 300)) + laser
    yield (
        "little acceleration",
        axis(
            "axis",
            "acceleration-limit",
            lag_us=between(150, 300),
            damping=between(0.7, 1.0),
            acceleration_limit_m_s2=between(2000, 4000),
        ),
    )


def calibrated(head: Path, folder: Path, generator: np.random.Generator) -> Path:
    """A head file that knows four noisy test lines along x and nothing else."""
    rows = ["speed_m_s,nominal_um,measured_um,acceleration_um"]
    for speed in SPEEDS_M_S:
        line = galvo.measure_line(head, speed_m_s=speed, length_um=8000)
        measured, acceleration = NOISE_UM * generator.standard_normal(2)
        rows.append(
            f"{speed},8000,{line.measured_um + measured},{line.acceleration_um + acceleration}"
        )
    lines = folder / "lines.csv"
    lines.write_text("\n".join(rows))
    known = folder / f"{head.stem}-known.toml"
    known.write_text(galvo.calibrate(lines).toml)
    return known


def plants(folder: Path, draws: int, seed: int) -> Iterator[Plant]:
    """The shipped heads, and ``draws`` heads of each family."""
    for name in galvo.HEADS:
        yield Plant("shipped", name, name)
    for draw in range(draws):
        generator = np.random.default_rng([seed, draw])
        for family, text in drawn_heads(generator):
            head = folder / f"{family.replace(' ', '-')}-{draw}.toml"
            head.write_text(text)
            if family == "late laser":
                # Test lines would show the response as a shorter lag, and the formulas would fit.
                known = folder / f"{head.stem}-known.toml"
                known.write_text(text[: text.index("[laser]")])
            else:
                known = calibrated(head, folder, generator)
            yield Plant(family, str(head), str(known))


def judged_lines(generator: np.random.Generator) -> list[tuple[float, float]]:
    """Lengths from 0.08 to 5 mm, evenly in their logarithm, and directions."""
    lengths = 80.0 * (5000.0 / 80.0) ** generator.random(JUDGED_LINES)
    angles = 360.0 * generator.random(JUDGED_LINES)
    return list(zip(lengths.tolist(), angles.tolist(), strict=True))


def main() -> None:
    """Tunes and judges, and prints a row for each family."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--draws", type=int, default=3, help="heads of each family")
    parser.add_argument("--evaluations", type=int, default=800, help="corrections at each speed")
    parser.add_argument("--seed", type=int, default=1, help="seed of heads, noise and lines")
    options = parser.parse_args()
    rows: dict[str, list[list[float]]] = {}
    with tempfile.TemporaryDirectory() as name:
        for k, plant in enumerate(plants(Path(name), options.draws, options.seed)):
            for speed in SPEEDS_M_S:
                tuned = galvo.tune(
                    plant.head,
                    speed_m_s=speed,
                    known=plant.known,
                    evaluations=options.evaluations,
                    seed=options.seed,
                )
                generator = np.random.default_rng([options.seed, k, round(10 * speed)])
                lines = judged_lines(generator)
                row = [tuned.formula_cost, tuned.cost]
                for correction in ((0.0,) * 5, tuned.correction_us):
                    made = galvo.machine_lines(
                        plant.head,
                        speed_m_s=speed,
                        lines=lines,
                        known=plant.known,
                        correction_us=correction,
                    )
                    edges = np.abs([made.start_error_um, made.end_error_um, made.lateral_error_um])
                    row += [
                        float(made.cost.mean()),
                        float(np.nanmax(edges)),
                        float(np.nanmax(made.pitch_deviation)),
                        float(made.time_us.mean()),
                    ]
                rows.setdefault(plant.family, []).append(row)
    judged = "cost  worst µm  pitch time µs"
    print(
        f"{'':<20} | tuned on       | {'judged: formulas':<29} | {'judged: tuned':<29} | not worse"
    )
    print(f"{'family':<20} | formulas tuned | {judged} | {judged} | tuned, judged")
    for family, of in rows.items():
        every = np.array(of)
        mean, worst = every.mean(0), every.max(0)
        figures = [
            f"{mean[k]:5.2f} {worst[k + 1]:8.1f} {worst[k + 2]:6.3f} {mean[k + 3]:7.0f}"
            for k in (2, 6)
        ]
        kept = [int((every[:, b] <= every[:, a]).sum()) for a, b in ((0, 1), (2, 6))]
        print(
            f"{family:<20} | {mean[0]:8.2f} {mean[1]:5.2f} | {figures[0]} | {figures[1]} | "
            f"{kept[0]}/{len(every)}, {kept[1]}/{len(every)}"
        )


if __name__ == "__main__":
    main()
