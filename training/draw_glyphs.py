"""Draws letters and digits as targets: ``python training/draw_glyphs.py FOLDER``.

DejaVu Sans Bold, which Matplotlib brings along: 62 drawings that no training has seen. Strokes
are about as wide as a mark.
"""

from __future__ import annotations

import argparse
import string
from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.patches import PathPatch
from matplotlib.textpath import TextPath


def draw_glyph(glyph: str, path: Path) -> None:
    """Writes a glyph as a black shape on white ground."""
    outline = TextPath(
        (0, 0), glyph, size=100, prop=FontProperties(family="DejaVu Sans", weight="bold")
    )
    box = outline.get_extents()
    figure = Figure(figsize=(box.width / 25, box.height / 25))
    axis = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axis.add_patch(PathPatch(outline, facecolor="black", linewidth=0))
    axis.set_xlim(box.x0, box.x1)
    axis.set_ylim(box.y0, box.y1)
    axis.set_axis_off()
    figure.savefig(path, dpi=100)


def main() -> None:
    """Draws all of them."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path, help="made where missing")
    folder: Path = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    for glyph in string.ascii_letters + string.digits:
        # File systems may not tell A.png from a.png.
        kind = "digit" if glyph.isdigit() else "upper" if glyph.isupper() else "lower"
        draw_glyph(glyph, folder / f"{kind}_{glyph.lower()}.png")


if __name__ == "__main__":
    main()
