"""Draws the pictures of these pages: ``python docs/make_pictures.py``.

Writes ``docs/pictures/*.png`` and ``*.gif``, and prints the score of each plan. Needs Pillow,
Matplotlib, and Chromium for the report of a job.
"""

from __future__ import annotations

import csv
import sys
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

import lasergym
from lasergym import remote, targets
from lasergym.cli.remote_figures import draw_figures
from lasergym.machine import Deciding, run_job
from lasergym.policy import SHIPPED_POLICIES, PolicyName
from lasergym.render import render_trajectory

HERE = Path(__file__).resolve().parent
PICTURES = HERE / "pictures"
THUMBS_UP = HERE.parent / "tests" / "assets" / "thumbs_up.svg"

EXCHANGER = HERE.parent / "tests" / "assets" / "heat_exchanger.toml"

WIDTH_PX = 480
REMOTE_WIDTH_PX = 800
TILE_PX = 210
GAP_PX = 8
COLORS = 64


def best_plan(target: targets.Target) -> lasergym.Plan:
    """45 pulses at most, annealed and in the order of shortest travel; the same on any machine."""
    return lasergym.plan(target, "anneal", max_pulses=45, iterations=2_000_000).ordered()


def draw_plan(name: str, target: targets.Target) -> None:
    """Writes ``name.png``: the plan of ``target`` with legend and score."""
    plan = best_plan(target)
    caption = (
        f"{plan.pulses} pulses, {plan.machined_fraction:.1%} machined, "
        f"{plan.off_target_fraction:.1%} off target"
    )
    picture = render_trajectory(target, plan, width_px=WIDTH_PX, caption=caption)
    write_png(picture, PICTURES / f"{name}.png")
    print(f"{name}: {caption}, reward {plan.reward:.4f}")


def draw_random_shapes(name: str, seeds: range, columns: int) -> None:
    """Writes ``name.png``: random shapes with their plans, side by side."""
    tiles = []
    for seed in seeds:
        target = targets.random_shape(seed)
        plan = best_plan(target)
        tiles.append(render_trajectory(target, plan, width_px=TILE_PX, legend=False))
        print(f"{name}, seed {seed}: {plan.pulses} pulses, reward {plan.reward:.4f}")
    write_png(mosaic(tiles, columns), PICTURES / f"{name}.png")


def draw_policy(policy: PolicyName, target: targets.Target) -> None:
    """Writes ``policy-….gif``: a shipped policy at work."""
    plan = lasergym.plan(target, "policy", policy=policy, max_pulses=-(-int(target.sum()) // 125))
    frames = [
        Image.fromarray(
            render_trajectory(target, plan.xy_px[:count], width_px=TILE_PX, legend=False)
        )
        for count in range(plan.pulses + 1)
    ]
    palette = frames[-1].quantize(COLORS // 2)
    first, *rest = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    path = PICTURES / f"policy-{policy}.gif"
    first.save(path, save_all=True, append_images=rest, duration=150, loop=0, optimize=True)
    print(f"policy-{policy}: {plan.pulses} pulses, reward {plan.reward:.4f}")


def draw_job_report(name: str) -> None:
    """Writes ``name.png``: the report of a job, as a browser shows it."""
    sys.path.insert(0, str(HERE.parent / "tests" / "python"))
    from headless_browser import HeadlessBrowser

    with tempfile.TemporaryDirectory() as folder:
        job = Path(folder) / "thumbs-up"
        deciding = Deciding(planner="anneal", first_iterations=2_000_000, moves=20_000)
        report = run_job(targets.load(THUMBS_UP), job, deciding=deciding)
        address = (job / "report.html").as_uri() + "#pulse=24"
        with HeadlessBrowser(address, width_px=900, height_px=640) as browser:
            browser.screenshot(job / "page.png")
        page = Image.open(job / "page.png").convert("RGB")
        write_png(np.asarray(page.crop((0, 0, page.width, 860))), PICTURES / f"{name}.png")
    print(f"{name}: {report.machined_fraction:.1%} machined, {report.off_target_fraction:.1%} off")


def draw_remote_plan(name: str) -> None:
    """Writes ``name.png``: lines and beam of the heat exchanger."""
    plan = remote.plan_file(EXCHANGER)
    with tempfile.TemporaryDirectory() as folder:
        (drawn,) = draw_figures(Path(folder), plan, plan.simulate(plan.cycle_time_s / 40_000))
        picture = Image.open(Path(folder) / drawn).convert("RGB")
    picture.thumbnail((REMOTE_WIDTH_PX, 2 * REMOTE_WIDTH_PX))
    write_png(np.asarray(picture), PICTURES / f"{name}.png")
    print(f"{name}: {plan.cycle_time_s:.3f} s")


def draw_pointing_error(name: str) -> None:
    """Writes ``name.png`` from ``pointing_error.csv``, which the Rust example prints."""
    curves: dict[str, list[tuple[float, float, float]]] = {}
    with (HERE / "pointing_error.csv").open(encoding="utf-8", newline="") as file:
        for error_px, decider, mean, spread in list(csv.reader(file))[1:]:
            curves.setdefault(decider, []).append((float(error_px), float(mean), float(spread)))
    figure = Figure(figsize=(6.4, 3.8), layout="constrained")
    axis = figure.subplots()
    # Okabe and Ito's palette, which colour-blind people can tell apart; open loops are dashed.
    colors = ("#0072B2", "#E69F00", "#CC79A7", "#D55E00", "#D55E00", "#009E73")
    for (decider, points), color in zip(curves.items(), colors, strict=True):
        errors_px, means, spreads = zip(*points, strict=True)
        line = "--" if decider.endswith("open loop") else "-"
        axis.errorbar(errors_px, means, spreads, fmt=f"o{line}", ms=3, color=color, label=decider)
    axis.set_xlabel("pointing error, standard deviation along each axis / px")
    axis.set_ylabel("reward · 10⁴ / area")
    axis.grid(color="#d9dce0", linewidth=0.5)
    axis.spines[["top", "right"]].set_visible(False)
    axis.legend(fontsize=8, frameon=False)
    figure.savefig(PICTURES / f"{name}.png", dpi=100)


def mosaic(tiles: list[NDArray[np.uint8]], columns: int) -> NDArray[np.uint8]:
    """Tiles of equal size, uint8 of shape (height, width, 3), on white, row by row."""
    height, width, _ = tiles[0].shape
    rows = -(-len(tiles) // columns)
    shape = (rows * (height + GAP_PX) - GAP_PX, columns * (width + GAP_PX) - GAP_PX, 3)
    sheet = np.full(shape, 255, np.uint8)
    for k, tile in enumerate(tiles):
        top, left = (k // columns) * (height + GAP_PX), (k % columns) * (width + GAP_PX)
        sheet[top : top + height, left : left + width] = tile
    return sheet


def write_png(picture: NDArray[np.uint8], path: Path) -> None:
    """Writes a picture, uint8 of shape (height, width, 3), with a palette to keep it small."""
    Image.fromarray(picture).quantize(COLORS).save(path, optimize=True)


def main() -> None:
    """Draws all pictures."""
    PICTURES.mkdir(exist_ok=True)
    draw_plan("star", targets.star())
    draw_plan("thumbs_up", targets.load(THUMBS_UP))
    draw_random_shapes("random_shapes", range(6), columns=3)
    shown = (targets.star(), targets.star(23.0), targets.random_shape(2_000_000_000))
    for policy, target in zip(SHIPPED_POLICIES, shown, strict=True):
        draw_policy(policy, target)
    draw_job_report("job_report")
    draw_remote_plan("remote_plan")
    draw_pointing_error("pointing_error")


if __name__ == "__main__":
    main()
