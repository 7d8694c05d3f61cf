"""The figures of a summary, drawn with matplotlib: written as PNG and SVG, or as pixels for a screen."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pfviz.experiments.summary import Curve, CurveFigure, CurvePanel, Figure, HeatFigure, HeatPanel
from pfviz.figures.style import matplotlib_set_to
from pfviz.particles import FloatArray

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#999999")
"""Okabe and Ito's palette, which the colour-blind can tell apart; line styles tell the rest."""
_STYLES = ("-", "--", ":")


_DPI = 130


def write_figure(figure: Figure, folder: Path) -> tuple[Path, Path]:
    """Write ``figure`` as PNG and SVG under its name; where they are."""
    png, svg = folder / f"{figure.name}.png", folder / f"{figure.name}.svg"
    with _drawn(figure) as canvas:
        canvas.savefig(png, dpi=_DPI, metadata={"Software": None})
        canvas.savefig(svg, metadata={"Date": None})
    return png, svg


def pixels_of(figure: Figure) -> NDArray[np.uint8]:
    """``(h, w, 3)``: ``figure`` in RGB, the same as its PNG."""
    with _drawn(figure) as canvas:
        canvas.dpi = _DPI
        canvas.canvas.draw()
        return np.array(canvas.canvas.buffer_rgba())[..., :3]


@contextmanager
def _drawn(figure: Figure) -> Iterator[Any]:
    """A figure of matplotlib's that looks as it should inside the block."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure as Canvas

    with matplotlib_set_to({"svg.hashsalt": f"pfviz {figure.name}", "font.size": 9}):
        canvas = Canvas(layout="constrained")
        FigureCanvasAgg(canvas)
        if isinstance(figure, CurveFigure):
            _draw_curves(canvas, figure)
        else:
            _draw_heat(canvas, figure)
        yield canvas


def _draw_curves(canvas: Any, figure: CurveFigure) -> None:
    """The axes fit the lines; intervals are drawn last and make no room, since with few runs they are very wide."""
    count = max(1, len(figure.panels))
    across = min(count, 3)
    down = -(-count // across)
    canvas.set_size_inches(max(6.4, 4.2 * across), 3.4 * down + 0.9)
    axes = canvas.subplots(down, across, squeeze=False, sharey=figure.shared_y).ravel()
    labels = list(dict.fromkeys(curve.label for panel in figure.panels for curve in panel.curves))
    for axis, panel in zip(axes, figure.panels, strict=False):
        axis.set_xscale("log" if figure.log_x else "linear")
        axis.set_yscale("log" if figure.log_y else "linear")
        for curve in panel.curves:
            _draw_line(axis, curve, labels.index(curve.label))
        if figure.log_x:
            _name_ticks(axis, panel)
        axis.set_title(panel.title)
        axis.set_xlabel(figure.x_label)
        axis.grid(alpha=0.25)
    for axis, panel in zip(axes, figure.panels, strict=False):
        axis.autoscale(False)
        for curve in panel.curves:
            _draw_interval(axis, curve, labels.index(curve.label))
    for axis in axes[::across]:
        axis.set_ylabel(figure.y_label)
    for axis in axes[len(figure.panels) :]:
        axis.set_visible(False)
    canvas.suptitle(figure.title)
    handles = dict(zip(*reversed(_legend_entries(axes)), strict=True))
    if handles:
        canvas.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=4, frameon=False)


def _legend_entries(axes: Any) -> tuple[list[Any], list[str]]:
    handles, labels = [], []
    for axis in axes:
        more = axis.get_legend_handles_labels()
        handles += more[0]
        labels += more[1]
    return handles, labels


def _draw_line(axis: Any, curve: Curve, index: int) -> None:
    colour = COLOURS[index % len(COLOURS)]
    style = _STYLES[(index // len(COLOURS)) % len(_STYLES)]
    marker = "o" if len(curve.x) <= 20 else None
    axis.plot(curve.x, curve.y, style, color=colour, label=curve.label, linewidth=1.4, marker=marker, markersize=3)


def _draw_interval(axis: Any, curve: Curve, index: int) -> None:
    if curve.low is not None and curve.high is not None:
        colour = COLOURS[index % len(COLOURS)]
        axis.fill_between(curve.x, curve.low, curve.high, color=colour, alpha=0.13, linewidth=0)


def _name_ticks(axis: Any, panel: CurvePanel) -> None:
    """On a logarithmic axis: ticks where something was measured, if those are few."""
    measured = sorted({float(value) for curve in panel.curves for value in curve.x})
    if len(measured) <= 12:
        axis.set_xticks(measured, [f"{value:g}" for value in measured])
        axis.set_xticks([], minor=True)


def _draw_heat(canvas: Any, figure: HeatFigure) -> None:
    from matplotlib.colors import LogNorm, Normalize

    across = min(figure.across, max(1, len(figure.panels)))
    down = -(-len(figure.panels) // across)
    canvas.set_size_inches(max(6.4, 3.1 * across + 0.8), 2.9 * down + 0.6)
    axes = canvas.subplots(down, across, squeeze=False).ravel()
    values = np.concatenate([panel.values[np.isfinite(panel.values)] for panel in figure.panels] or [np.zeros(0)])
    if figure.log_values:
        values = values[values > 0]
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.1, 1.0)
    high = high if high > low else low + max(abs(low), 1e-9)
    norm = LogNorm(low, high) if figure.log_values else Normalize(low, high)
    image = None
    for axis, panel in zip(axes, figure.panels, strict=False):
        image = _draw_heat_panel(axis, panel, norm)
        axis.set_xlabel(figure.x_label)
        axis.set_ylabel(figure.y_label)
    for axis in axes[len(figure.panels) :]:
        axis.set_visible(False)
    canvas.suptitle(figure.title)
    if image is not None:
        canvas.colorbar(image, ax=list(axes), label=figure.value_label, shrink=0.8)


def _draw_heat_panel(axis: Any, panel: HeatPanel, norm: Any) -> Any:
    image = axis.imshow(panel.values, norm=norm, cmap="viridis", origin="lower", aspect="auto")
    axis.set_xticks(range(len(panel.columns)), [f"{value:g}" for value in panel.columns])
    axis.set_yticks(range(len(panel.rows)), [f"{value:g}" for value in panel.rows])
    axis.set_title(panel.title)
    shown = np.ma.filled(norm(np.ma.masked_invalid(panel.values)), np.nan)
    for (row, column), value in np.ndenumerate(panel.values):
        if np.isfinite(value):
            colour = "white" if shown[row, column] < 0.6 else "black"
            axis.text(column, row, f"{value:.2g}", ha="center", va="center", color=colour, fontsize=7)
    if panel.marked is not None:
        _outline(axis, panel.marked)
    return image


def _outline(axis: Any, marked: FloatArray) -> None:
    from matplotlib.patches import Rectangle

    for row, column in np.argwhere(marked):
        axis.add_patch(Rectangle((column - 0.47, row - 0.47), 0.94, 0.94, fill=False, edgecolor="#D55E00", linewidth=2))
