"""What all figures share: colours with a meaning, strengths, and files whose bytes depend on what is drawn alone."""

from __future__ import annotations

import io
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from pfviz.particles import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Format = Literal["png", "svg", "pdf"]
FORMATS: tuple[str, ...] = get_args(Format)

HISTORY = "#0072B2"
PROPOSAL = "#E69F00"
LIKELIHOOD = "#7A6F10"
POSTERIOR = "#009E73"
EXACT = "#000000"
TRUTH = "#D55E00"
RIVAL = "#CC79A7"
INK = "#282C34"
FAINT = "#C8CDD3"
"""The set of Okabe and Ito; one colour, one meaning, in the app and here."""

_LOCK = threading.Lock()
_METADATA: dict[str, dict[str, Any]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": "pfviz"},
    "pdf": {"CreationDate": None, "Creator": "pfviz"},
}


@contextmanager
def matplotlib_set_to(settings: Mapping[Any, Any]) -> Iterator[None]:
    """While the block runs matplotlib has these settings. They are everybody's, so one thread at a time has its way."""
    from matplotlib import rc_context

    with _LOCK, rc_context(dict(settings)):
        yield


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of so many inches with a canvas of its own."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=100, facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def render(figure: Figure, format: Format | str = "png", dpi: float = 200.0) -> bytes:
    """The file that holds ``figure``. Equal figures give equal bytes, whenever and in whatever thread they are drawn.

    Lettering in an SVG is drawn as curves, so that it looks the same everywhere; in a PDF it is text.

    Args:
        figure: as the functions of this package return it.
        format: "png", "svg" or "pdf".
        dpi: pixels per inch, of a PNG and of images within the others.

    Raises:
        ValueError: if there is no such format.
    """
    if format not in FORMATS:
        raise ValueError(f"format must be one of {', '.join(FORMATS)}, got {format!r}")
    stream = io.BytesIO()
    with matplotlib_set_to({"svg.hashsalt": "pfviz", "svg.fonttype": "path", "pdf.fonttype": 42}):
        figure.savefig(stream, format=format, dpi=dpi, metadata=_METADATA[format])
    return stream.getvalue()


def relative(weights: FloatArray) -> FloatArray:
    """Weights as strengths: the largest is 1."""
    return weights / weights.max()


def tints(colour: str, strengths: FloatArray, weakest: str = "#E4E7EA") -> NDArray[np.float64]:
    """``(n, 3)``: from the colour ``weakest`` to ``colour`` by ``strengths (n,)`` from 0 to 1."""
    from matplotlib.colors import to_rgb

    share = np.clip(strengths, 0.0, 1.0)[:, None]
    return (1.0 - share) * np.array(to_rgb(weakest)) + share * np.array(to_rgb(colour))


def weighted_points(
    axes: Axes, points: FloatArray, strengths: FloatArray, colour: str, size: float, order: float, marker: str = "o"
) -> None:
    """Points ``(n, 2)`` whose colour and area grow with their strengths ``(n,)``; the strongest on top."""
    rank = np.argsort(strengths, kind="stable")
    axes.scatter(
        points[rank, 0],
        points[rank, 1],
        s=size * (0.25 + 0.75 * strengths[rank]),
        c=tints(colour, strengths[rank]),
        marker=marker,
        edgecolors="white",
        linewidths=0.5,
        zorder=order,
        clip_on=False,
    )


def weighted_lines(
    axes: Axes, segments: FloatArray, strengths: FloatArray, colour: str, width: float, order: float
) -> None:
    """Lines ``(n, 2, 2)`` whose colour and width grow with their strengths ``(n,)``; the strongest on top."""
    from matplotlib.collections import LineCollection

    rank = np.argsort(strengths, kind="stable")
    axes.add_collection(
        LineCollection(
            list(segments[rank]),
            colors=tints(colour, strengths[rank]),
            linewidths=width * (0.35 + 0.65 * strengths[rank]),
            capstyle="round",
            zorder=order,
        ),
        autolim=False,
    )


def arrows(axes: Axes, segments: FloatArray, strengths: FloatArray, colour: str, width: float, order: float) -> None:
    """Arrows along lines ``(n, 2, 2)``, shortened a little at both ends, so that they do not cover what they join."""
    from matplotlib.patches import FancyArrowPatch

    for rank in np.argsort(strengths, kind="stable"):
        start, end = segments[rank]
        axes.add_patch(
            FancyArrowPatch(
                tuple(start),
                tuple(end),
                arrowstyle="-|>,head_length=0.32,head_width=0.14",
                mutation_scale=9.0,
                shrinkA=3.0,
                shrinkB=3.5,
                linewidth=width * (0.35 + 0.65 * float(strengths[rank])),
                color=tuple(tints(colour, strengths[[rank]])[0]),
                zorder=order,
                clip_on=False,
            )
        )


def bare(axes: Axes) -> None:
    """Take away the frame and the ticks."""
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(False)


def quiet(axes: Axes) -> None:
    """A light frame of two lines and a faint grid."""
    for name, spine in axes.spines.items():
        spine.set_visible(name in ("left", "bottom"))
        spine.set_color(INK)
        spine.set_linewidth(0.7)
    axes.tick_params(labelsize=8, color=INK, labelcolor=INK, width=0.7, length=3)
    axes.grid(True, color=FAINT, linewidth=0.4, alpha=0.6)
    axes.set_axisbelow(True)


def sample(strengths: FloatArray, count: int) -> NDArray[np.int64]:
    """At most ``count`` indices into ``strengths (n,)``: the strongest, and others evenly spread, half and half."""
    total = len(strengths)
    if total <= count:
        return np.arange(total)
    strongest = np.argsort(-strengths, kind="stable")[: count // 2]
    evenly = np.linspace(0, total - 1, count - count // 2).astype(np.int64)
    return np.union1d(strongest, evenly)
