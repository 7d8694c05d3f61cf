"""One iteration, in as many dimensions as its world has."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pfviz.exact import Gaussian, GridMarginal
from pfviz.figures.line import plot_line
from pfviz.figures.plane import plot_plane
from pfviz.model import Model
from pfviz.particles import FloatArray
from pfviz.record import StepRecord

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_step(
    record: StepRecord,
    model: Model,
    truth: FloatArray | None = None,
    exact: Gaussian | GridMarginal | None = None,
    title: str = "",
    extent: float | None = None,
) -> Figure:
    """One iteration: ``plot_line`` in one dimension, ``plot_plane`` in two. See there.

    Raises:
        ValueError: if the model has more dimensions.
    """
    dimension = model.dynamics.dimension
    if dimension == 1:
        return plot_line(record, model, truth, exact, title, extent)
    if dimension == 2:
        return plot_plane(record, model, truth, exact, title, extent)
    raise ValueError(f"a step can be drawn in 1 or 2 dimensions, the model has {dimension}; see plot_frame for video")
