"""Figures of the study: maps of a displaced pulse, and curves over the other disturbances."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lasergym.comparison.figures import import_matplotlib
from lasergym.disturbances.study import CONTESTANTS, Study
from lasergym.disturbances.trials import CONTINUOUS, GRID_SIDE

__all__ = ["draw_figures"]

_COLOURS = {"closed": "#CC79A7", "open": "#009E73", "cma-es": "#0072B2", "anneal": "#D55E00"}
"""From Okabe and Ito's palette, which colour-blind people can tell apart."""

_LARGEST_LOSS = 0.02
"""Reward lost that is drawn brightest."""

_LABELS = {
    "vibration": "vibration, standard deviation / px",
    "backlash": "backlash / px",
    "drift": "drift / px per pulse",
    "misfire": "probability of a misfire",
}


def draw_figures(study: Study, folder: Path) -> list[Path]:
    """Writes ``displaced.png`` and ``disturbances.png``.

    Args:
        study: The results.
        folder: Where they go.

    Raises:
        MissingExtraError: Matplotlib is not installed.
    """
    return [_draw_displaced(study, folder), _draw_continuous(study, folder)]


def _draw_displaced(study: Study, folder: Path) -> Path:
    """For each shape and contestant, the reward lost by where the 5th pulse went."""
    figure_class = import_matplotlib("matplotlib.figure").Figure
    found = [one for one in study.results if one.trial.disturbance == "displaced"]
    shapes = list(dict.fromkeys(one.trial.shape for one in found))
    figure = figure_class(figsize=(7.2, 1.5 * len(shapes) + 0.6), layout="constrained")
    axes = figure.subplots(len(shapes), len(CONTESTANTS), squeeze=False)
    image = None
    for axis, title in zip(axes[0], CONTESTANTS.values(), strict=True):
        axis.set_title(title, fontsize=7)
    for row, shape in zip(axes, shapes, strict=True):
        row[0].set_ylabel(shape, fontsize=8)
        for axis, contestant in zip(row, CONTESTANTS, strict=True):
            losses = np.full((GRID_SIDE, GRID_SIDE), np.nan)
            for one in found:
                if (one.trial.shape, one.trial.contestant) == (shape, contestant):
                    place = divmod(int(one.trial.level), GRID_SIDE)
                    losses[place] = one.best_reward - one.score.reward
            image = axis.imshow(
                losses, vmin=0, vmax=_LARGEST_LOSS, cmap="cividis", extent=(0, 100, 100, 0)
            )
            axis.set_xticks([])
            axis.set_yticks([])
    if image is not None:
        bar = figure.colorbar(image, ax=axes, shrink=0.6)
        bar.set_label("best reward still possible − reward", fontsize=7)
    path = folder / "displaced.png"
    figure.savefig(path, dpi=110)
    return path


def _draw_continuous(study: Study, folder: Path) -> Path:
    figure_class = import_matplotlib("matplotlib.figure").Figure
    figure = figure_class(figsize=(7.2, 5.0), layout="constrained")
    axes = figure.subplots(2, 2)
    for axis, disturbance in zip(axes.flat, CONTINUOUS, strict=True):
        for contestant, label in CONTESTANTS.items():
            means = study.mean_reward(disturbance, contestant)
            axis.plot(
                list(means), list(means.values()), "o-", color=_COLOURS[contestant], label=label
            )
        axis.set_xlabel(_LABELS[disturbance], fontsize=8)
        axis.set_ylabel("mean reward", fontsize=8)
        axis.grid(color="#d9dce0", linewidth=0.5)
        axis.spines[["top", "right"]].set_visible(False)
    axes[0][0].legend(fontsize=7, frameon=False)
    path = folder / "disturbances.png"
    figure.savefig(path, dpi=110)
    return path
