"""Pictures of a milling job, as in Figs. 17 to 24 of the paper; they need matplotlib."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lasergym.milling import MillingResult

__all__ = ["draw_figures"]


def draw_figures(folder: Path, result: MillingResult) -> tuple[str, ...]:
    """Draws surface and error map, cross-sections and convergence.

    Args:
        folder: Where the PNG files go.
        result: The passes and their surface.

    Returns:
        Names of the files; none where matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError:
        return ()

    rows, columns = result.target_um.shape
    side_mm = result.pixel_um * 1e-3
    extent = (0.0, columns * side_mm, rows * side_mm, 0.0)

    maps = Figure(figsize=(12, 4), layout="constrained")
    error_um = result.depth_um - result.target_um
    largest = max(float(np.quantile(np.abs(error_um), 0.995)), 1e-9)
    pictures = (
        ("target depth, µm", result.target_um, "viridis_r", None),
        ("predicted depth, µm", result.depth_um, "viridis_r", None),
        ("error, µm", error_um, "coolwarm", largest),
    )
    for axes, (title, field, colours, limit) in zip(maps.subplots(1, 3), pictures, strict=True):
        low, high = (0.0, result.target_um.max()) if limit is None else (-limit, limit)
        shown = axes.imshow(field, cmap=colours, extent=extent, vmin=low, vmax=high)
        axes.set(title=title, xlabel="x, mm", ylabel="y, mm")
        maps.colorbar(shown, ax=axes, shrink=0.8)
    maps.savefig(folder / "surface.png", dpi=120)

    sections = Figure(figsize=(9, 8), layout="constrained")
    x_mm = (np.arange(columns) + 0.5) * side_mm
    panels = sections.subplots(4, 1, sharex=True, sharey=True)
    for axes, part in zip(panels, (0.2, 0.4, 0.6, 0.8), strict=True):
        row = min(int(part * rows), rows - 1)
        axes.plot(x_mm, -result.target_um[row], "k--", linewidth=1, label="target")
        axes.plot(x_mm, -result.depth_um[row], "C0", linewidth=1, label="predicted")
        axes.set(ylabel="z, µm", title=f"y = {(row + 0.5) * side_mm:.3g} mm")
    axes.set(xlabel="x, mm")
    axes.legend()
    sections.savefig(folder / "sections.png", dpi=120)

    progress = Figure(figsize=(6, 4), layout="constrained")
    axes = progress.subplots()
    axes.semilogy(result.convergence_percent)
    axes.set(xlabel="iteration", ylabel="tracking error, %")
    axes.grid(visible=True, which="both", alpha=0.3)
    progress.savefig(folder / "convergence.png", dpi=120)
    return ("surface.png", "sections.png", "convergence.png")
