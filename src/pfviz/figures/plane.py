"""One iteration in a two-dimensional world: what Figures 1 and 2 of the sources are in one dimension."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from pfviz.exact import Gaussian, GridMarginal
from pfviz.figures import style
from pfviz.figures.reading import innovation_strengths, made_pairs, outcome, possible_pairs, proposal_stage
from pfviz.model import Model, is_missing
from pfviz.particles import FloatArray
from pfviz.record import StepRecord

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_POINTS, _LINES, _CELLS = 800, 160, 161
_SIDE, _GAP = 3.3, 0.36
"""Of a panel and between panels, in inches."""
_LEVELS = np.array([0.02, 0.1, 0.25, 0.5, 0.75, 1.0001])
Span = tuple[float, float, float, float]


def plot_plane(
    record: StepRecord,
    model: Model,
    truth: FloatArray | None = None,
    exact: Gaussian | GridMarginal | None = None,
    title: str = "",
    extent: float | None = None,
) -> Figure:
    """One iteration in a two-dimensional world, in four panels of one scale.

    The particles before, each a state with a tail to its history; the density of the proposal with the innovations
    drawn from it, joined to states as in ``plot_line``; the likelihood; and the new particles, strength as weight, with
    the estimate, the truth and, where it is a Gaussian that is known, the ellipse that holds 86% (two deviations) of
    the exact posterior.

    Args:
        record: the step.
        model: that the filter believed in.
        truth: ``(2,)``, where it is known.
        exact: the exact posterior of the innovation, where it is known.
        title: above everything.
        extent: half the width of the panels about 0, in the units of the world; by default everything fits in.
    """
    span = (-extent, extent, -extent, extent) if extent else _span(record, truth)
    height = 2.0 * (_SIDE + _GAP) + (0.35 if title else 0.05)
    figure = style.new_figure(2.0 * _SIDE + 0.6, height)
    figure.suptitle(title, fontsize=12, color=style.INK, y=1.0 - 0.1 / height, va="top")
    names = ("particles before", "innovations and their joins", "likelihood", "new particles")
    panels = [_panel(figure, number, span, name) for number, name in enumerate(names)]
    _before(panels[0], record)
    _proposed(panels[1], record, model, span)
    _likelihood(panels[2], record, model, span)
    _after(panels[3], record, truth, exact)
    return figure


def _panel(figure: Figure, number: int, span: Span, name: str) -> Axes:
    row, column = divmod(number, 2)
    width, height = figure.get_figwidth(), figure.get_figheight()
    left, bottom = 0.2 + column * (_SIDE + 0.2), 0.08 + (1 - row) * (_SIDE + _GAP)
    axes = figure.add_axes((left / width, bottom / height, _SIDE / width, _SIDE / height))
    axes.set_xlim(span[0], span[1])
    axes.set_ylim(span[2], span[3])
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_color(style.FAINT)
    axes.set_title(name, fontsize=10, color=style.INK, pad=4)
    return axes


def _span(record: StepRecord, truth: FloatArray | None) -> Span:
    """A square that everything fits in."""
    drawn = proposal_stage(record).particles.states
    places = [record.previous.states, record.posterior.states]
    places += [drawn] if drawn.shape[2] == 2 else [outcome(record).particles.states]
    places += [] if truth is None else [truth]
    points = np.concatenate([place.reshape(-1, 2) for place in places])
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    reach = 0.54 * float(np.ptp(points, axis=0).max()) + 1e-9
    return middle[0] - reach, middle[0] + reach, middle[1] - reach, middle[1] + reach


def _tails(older: FloatArray, newer: FloatArray) -> FloatArray:
    return np.stack([older, newer], axis=1)


def _size(count: int) -> float:
    return float(np.clip(34.0 - 11.0 * np.log10(max(count, 24) / 24.0), 8.0, 34.0))


def _before(axes: Axes, record: StepRecord) -> None:
    particles = record.previous
    strengths = style.relative(particles.weights)
    some = style.sample(strengths, _POINTS)
    if particles.order > 1:
        lines = _tails(particles.states[some, 1], particles.states[some, 0])
        style.weighted_lines(axes, lines, strengths[some], style.HISTORY, 1.2, 1)
    style.weighted_points(axes, particles.innovation[some], strengths[some], style.HISTORY, _size(len(some)), 3)


def _density(axes: Axes, log_density: Callable[[FloatArray], FloatArray], span: Span, colour: str) -> None:
    """Filled contours of a density, at shares of its largest value in the panel."""
    x, y = np.linspace(span[0], span[1], _CELLS), np.linspace(span[2], span[3], _CELLS)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    values = log_density(points).reshape(_CELLS, _CELLS)
    heights = np.exp(values - values.max())
    fills = style.tints(colour, np.linspace(0.08, 0.5, len(_LEVELS) - 1), "white")
    axes.contourf(x, y, heights, levels=_LEVELS, colors=[tuple(fill) for fill in fills], zorder=-2)


def _proposed(axes: Axes, record: StepRecord, model: Model, span: Span) -> None:
    stage = proposal_stage(record)
    innovations = stage.particles.innovation
    if stage.kind == "propose" and innovations.shape[1] == 2:
        density = stage.proposal or model.proposal(record.observation)
        _density(axes, density.log_density, span, style.PROPOSAL)
    if innovations.shape[1] != 2:
        innovations = _completed(record)
    before, possible, made = record.previous.innovation, possible_pairs(record), made_pairs(record)
    if possible is not None and len(possible.sources):
        lines = _tails(before[possible.sources], innovations[possible.targets])
        style.weighted_lines(axes, lines, style.relative(possible.strengths), style.PROPOSAL, 1.6, 1)
    some = style.sample(made.strengths, _LINES)
    lines = _tails(before[made.sources[some]], innovations[made.targets[some]])
    colour, width = (style.PROPOSAL, 1.3) if possible is None else (style.INK, 0.6)
    style.weighted_lines(axes, lines, made.strengths[some], colour, width, 2)
    style.weighted_points(axes, before, np.full(len(before), 0.5), style.HISTORY, 0.5 * _size(len(before)), 3)
    strengths = innovation_strengths(record)
    shown = style.sample(strengths, _POINTS)
    style.weighted_points(axes, innovations[shown], strengths[shown], style.PROPOSAL, 0.8 * _size(len(shown)), 4, "D")


def _completed(record: StepRecord) -> FloatArray:
    """``(N, 2)``: the innovations with what the proposal did not cover, as the new particles have it; NaN for none."""
    new = outcome(record)
    whole = np.full((len(proposal_stage(record).particles), 2), np.nan)
    whole[new.proposed] = new.particles.innovation
    return whole


def _likelihood(axes: Axes, record: StepRecord, model: Model, span: Span) -> None:
    if is_missing(record.observation):
        axes.text(0.5, 0.5, "nothing was observed", transform=axes.transAxes, ha="center", va="center", fontsize=10)
        return
    _density(axes, lambda points: model.log_likelihood(points, record.observation), span, style.LIKELIHOOD)
    if isinstance(record.observation, np.ndarray) and record.observation.shape[-1] == 2:
        seen = record.observation.reshape(-1, 2)
        axes.plot(seen[:, 0], seen[:, 1], "x", color=style.LIKELIHOOD, markersize=6, markeredgewidth=1.6)


def _after(axes: Axes, record: StepRecord, truth: FloatArray | None, exact: Gaussian | GridMarginal | None) -> None:
    new = outcome(record)
    particles, strengths = new.particles, new.strengths
    known = np.flatnonzero(new.histories >= 0)
    known = known[style.sample(strengths[known], _POINTS)]
    lines = _tails(record.previous.innovation[new.histories[known]], particles.innovation[known])
    style.weighted_lines(axes, lines, strengths[known], style.POSTERIOR, 1.4, 1)
    some = style.sample(strengths, _POINTS)
    style.weighted_points(axes, particles.innovation[some], strengths[some], style.POSTERIOR, _size(len(some)), 3)
    x, y = record.estimate
    axes.plot(x, y, "+", color="white", markersize=15, markeredgewidth=4.4, zorder=5)
    axes.plot(x, y, "+", color=style.POSTERIOR, markersize=14, markeredgewidth=2.2, zorder=5)
    lines = [("+ estimate", style.POSTERIOR), (f"ESS {record.effective_sample_size:.1f}", style.POSTERIOR)]
    if truth is not None:
        axes.plot(*truth, "o", markerfacecolor="none", color=style.TRUTH, markersize=11, markeredgewidth=2, zorder=6)
        lines.append(("o truth", style.TRUTH))
    if isinstance(exact, Gaussian):
        outline = _ellipse(exact)
        axes.plot(outline[:, 0], outline[:, 1], color=style.EXACT, linewidth=1.3, linestyle=(0, (4, 2)), zorder=5)
        lines.append(("-- exact, two deviations", style.EXACT))
    for number, (text, colour) in enumerate(lines):
        axes.text(0.03, 0.97 - 0.065 * number, text, transform=axes.transAxes, color=colour, fontsize=8.5, va="top")


def _ellipse(exact: Gaussian) -> FloatArray:
    """``(n, 2)``: two deviations about the mean."""
    angles = np.linspace(0.0, 2.0 * np.pi, 121)
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return exact.mean + 2.0 * circle @ np.linalg.cholesky(exact.covariance).T
