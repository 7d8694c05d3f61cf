"""Figure 3 of the sources: a frame of the video, contours of likely particles dark, the expected contour white."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pfviz.figures import style
from pfviz.particles import FloatArray
from pfviz.record import StepRecord
from pfviz.vision.drawing import likely_states
from pfviz.vision.tracker import TrackerModel, TrackEstimate
from pfviz.vision.video import Image

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LIKELY = 14
_DARK, _PALE = "#0A0A0E", "#E1E1E1"


def plot_frame(
    image: Image,
    model: TrackerModel,
    record: StepRecord,
    estimate: TrackEstimate | None = None,
    truth: TrackEstimate | None = None,
    title: str = "",
    close_up: bool = True,
) -> Figure:
    """A BGR frame with what the tracker makes of it, after Figure 3 (Figure 5 of the second text).

    Contours of likely particles are dark, the expected one is white, each with a thin rim of the opposite tone, so that
    they show on any background. The outlines are vectors, the frame is an image.

    Args:
        image: the frame, of the model's size.
        model: that the filter believed in.
        record: what it did with the frame.
        estimate: the expected configuration; the model's own estimate by default.
        truth: marked by a cross, where it is known.
        title: above everything.
        close_up: whether to show what is about the estimate beside the frame, enlarged.

    Raises:
        ValueError: if the image is not of the model's size.
    """
    height, width = image.shape[:2]
    if (width, height) != model.size:
        raise ValueError(f"expected a frame of {model.size}, got {(width, height)} (width, height)")
    estimate = estimate or model.estimate(record)
    tall = 3.4
    wide = tall * width / height
    top = 0.35 if title else 0.0
    figure = style.new_figure(wide + (tall + 0.08 if close_up else 0.0), tall + top)
    total, share = figure.get_figwidth(), tall / (tall + top)
    likely = model.contour.outlines(likely_states(record, _LIKELY))
    expected = model.contour.outlines(estimate.state)
    whole = _window(figure, (0.0, 0.0, wide / total, share), image, (0.0, float(width), float(height), 0.0))
    _outlines(whole, likely, expected, 1.0)
    if close_up:
        part = _about(estimate)
        near = _window(figure, (1.0 - tall / total, 0.0, tall / total, share), image, part)
        _outlines(near, likely, expected, 1.4)
        _truth(near, truth)
        _border(whole, part)
    _truth(whole, truth)
    if title:
        figure.text(0.5, 1.0 - 0.5 * (1.0 - share), title, ha="center", va="center", fontsize=11, color=style.INK)
    return figure


Part = tuple[float, float, float, float]


def _about(estimate: TrackEstimate) -> Part:
    """Left, right, bottom and top of a square about the estimate."""
    reach = 0.85 * max(estimate.box[2], estimate.box[3], 12.0)
    return estimate.x - reach, estimate.x + reach, estimate.y + reach, estimate.y - reach


def _window(figure: Figure, place: tuple[float, float, float, float], image: Image, part: Part) -> Axes:
    """A part of the frame; pixel (0, 0) covers the square from 0 to 1."""
    axes = figure.add_axes(place)
    height, width = image.shape[:2]
    shown = np.ascontiguousarray(image[..., ::-1])
    axes.imshow(shown, extent=(0.0, width, height, 0.0), interpolation="bilinear", aspect="auto")
    axes.set_xlim(part[0], part[1])
    axes.set_ylim(part[2], part[3])
    style.bare(axes)
    axes.set_facecolor("#707070")
    return axes


def _outlines(axes: Axes, likely: FloatArray, expected: FloatArray, scale: float) -> None:
    from matplotlib.collections import PolyCollection

    layers = (
        (likely, _PALE, 1.1, 2),
        (likely, _DARK, 0.6, 3),
        (expected, _DARK, 2.0, 4),
        (expected, "white", 1.2, 5),
    )
    for outlines, colour, width, order in layers:
        axes.add_collection(
            PolyCollection(
                list(outlines), facecolors="none", edgecolors=colour, linewidths=scale * width, zorder=order
            ),
            autolim=False,
        )


def _truth(axes: Axes, truth: TrackEstimate | None) -> None:
    if truth is not None:
        axes.plot(truth.x, truth.y, "+", color="white", markersize=11, markeredgewidth=3.4, zorder=6)
        axes.plot(truth.x, truth.y, "+", color=style.TRUTH, markersize=10, markeredgewidth=2.0, zorder=7)


def _border(axes: Axes, part: Part) -> None:
    """Where in the frame the close-up lies."""
    x = [part[0], part[1], part[1], part[0], part[0]]
    y = [part[2], part[2], part[3], part[3], part[2]]
    axes.plot(x, y, color="white", linewidth=1.8, zorder=8)
    axes.plot(x, y, color=style.POSTERIOR, linewidth=1.0, zorder=9)
