"""Figures 1 and 2 of the sources: one iteration in a one-dimensional world, read from top to bottom."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pfviz.exact import Gaussian, GridMarginal, smoothed_density, total_variation
from pfviz.figures import style
from pfviz.figures.reading import innovation_strengths, made_pairs, outcome, possible_pairs, proposal_stage
from pfviz.model import Model, is_missing
from pfviz.particles import FloatArray, ParticleSet
from pfviz.record import StepRecord

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_POINTS, _LINES, _HEADS = 600, 240, 60
_CURVE, _POSTERIOR_CURVE = 0.95, 1.45


@dataclass(frozen=True, slots=True)
class _Page:
    """Where things are drawn.

    Attributes:
        axes: values of the world across, rows down.
        low: the left end.
        high: the right end.
        heights: of the rows by name.
    """

    axes: Axes
    low: float
    high: float
    heights: dict[str, float]

    @property
    def grid(self) -> FloatArray:
        return np.linspace(self.low, self.high, 481)

    def at(self, values: FloatArray, row: str) -> FloatArray:
        """``(n, 2)``: points in a row; what lies outside the picture is drawn at its edge."""
        return np.stack([np.clip(values, self.low, self.high), np.full(len(values), self.heights[row])], axis=1)

    def between(self, upper: FloatArray, upper_row: str, lower: FloatArray, lower_row: str) -> FloatArray:
        """``(n, 2, 2)``: lines from row to row."""
        return np.stack([self.at(upper, upper_row), self.at(lower, lower_row)], axis=1)

    def row(self, name: str, label: str, colour: str) -> None:
        """A row's axis and its name."""
        y = self.heights[name]
        self.axes.plot([self.low, self.high], [y, y], color=style.FAINT, linewidth=0.7, zorder=0)
        x = self.low - 0.025 * (self.high - self.low)
        self.axes.text(x, y, label, color=colour, fontsize=10.5, ha="right", va="center")

    def note(self, y: float, text: str, colour: str) -> None:
        """A remark at the right, at the height ``y``."""
        x = self.high + 0.025 * (self.high - self.low)
        self.axes.text(x, y, text, color=colour, fontsize=8.5, ha="left", va="center")

    def curve(self, heights: FloatArray, row: str, colour: str, reach: float, dashed: bool = False) -> None:
        """A curve of ``heights`` from 0 to 1 that stands on a row, over a tint of its colour."""
        y = self.heights[row]
        if not dashed:
            fill = tuple(style.tints(colour, np.array([0.16]), "white")[0])
            self.axes.fill_between(self.grid, y, y + reach * heights, color=fill, linewidth=0, zorder=-2)
        line: Any = (0, (4, 2)) if dashed else "-"
        self.axes.plot(self.grid, y + reach * heights, color=colour, linewidth=1.5, linestyle=line, zorder=3)

    def tick(self, value: float, row: str, colour: str, reach: float, width: float = 2.2) -> None:
        y, x = self.heights[row], float(np.clip(value, self.low, self.high))
        self.axes.plot([x, x], [y - reach, y + reach], color=colour, linewidth=width, zorder=6, solid_capstyle="butt")


def plot_line(
    record: StepRecord,
    model: Model,
    truth: FloatArray | None = None,
    exact: Gaussian | GridMarginal | None = None,
    title: str = "",
    extent: float | None = None,
) -> Figure:
    """One iteration in a one-dimensional world, after Figures 1 and 2 of Torma & Szepesvari.

    From top to bottom: histories and states, joined by the particles; the innovations, with the density that they were
    drawn from below them, and arrows from the states that they were joined to. Where innovations were joined by index
    the strength of an arrow is p(u | x) relative to its peak; where histories were sampled every possible join is drawn
    with its probability and the one drawn is an arrow; then the likelihood; the new particles, strength as weight; and
    their density beside the exact posterior.

    Args:
        record: the step.
        model: that the filter believed in.
        truth: ``(1,)``, where it is known.
        exact: the exact posterior of the innovation, where it is known.
        title: above everything.
        extent: half the width of the picture about 0, in the units of the world; by default everything fits in.
    """
    proposes = record.stage("propose") is not None
    weighs = not is_missing(record.observation)
    heights = _heights(record.previous.order > 1, proposes, weighs)
    top = max(heights.values())
    height = 0.58 * top + 1.0
    figure = style.new_figure(7.2, height)
    axes = figure.add_axes((0.16, 0.1 / height, 0.63, 1.0 - 0.5 / height))
    low, high = (-extent, extent) if extent else _span(record, truth, exact)
    page = _Page(axes, low, high, heights)
    style.bare(axes)
    axes.set_xlim(low, high)
    axes.set_ylim(-0.45, top + 0.25)
    axes.set_title(title, fontsize=12, color=style.INK, pad=6)

    _before(page, record.previous)
    _proposed(page, record, model, proposes)
    _joins(page, record)
    if weighs:
        _likelihood(page, record, model)
    _after(page, record, truth)
    _posterior(page, record.posterior, truth, exact)
    return figure


def _heights(with_history: bool, proposes: bool, weighs: bool) -> dict[str, float]:
    """The rows from the bottom up; those that there is nothing to draw in are left out."""
    gaps = [("posterior", 0.0), ("state", 2.15), ("history", 1.3)]
    gaps += [("likelihood", 0.75)] if weighs else []
    gaps += [("proposal", 1.5)] if proposes else []
    gaps += [("proposed", 1.2 if proposes else 1.5), ("newer", 2.9)]
    gaps += [("older", 1.0)] if with_history else []
    levels = np.cumsum([gap for _, gap in gaps])
    return {name: float(level) for (name, _), level in zip(gaps, levels, strict=True)}


def _span(record: StepRecord, truth: FloatArray | None, exact: Gaussian | GridMarginal | None) -> tuple[float, float]:
    """From where to where everything fits in."""
    values = [record.previous.states.ravel(), proposal_stage(record).particles.states.ravel()]
    values += [record.posterior.states.ravel(), np.zeros(0) if truth is None else truth]
    if exact is not None:
        reach = 3.2 * float(np.sqrt(exact.covariance[0, 0]))
        values.append(exact.mean[:1] + np.array([-reach, reach]))
    everything = np.concatenate(values)
    margin = 0.05 * float(np.ptp(everything)) + 1e-9
    return float(everything.min()) - margin, float(everything.max()) + margin


def _size(count: int) -> float:
    """The area of a point, in square points: smaller where there are many."""
    return float(np.clip(46.0 - 13.0 * np.log10(max(count, 24) / 24.0), 10.0, 46.0))


def _before(page: _Page, particles: ParticleSet) -> None:
    strengths = style.relative(particles.weights)
    shown = style.sample(strengths, _POINTS)
    newer = particles.states[:, 0, 0]
    page.row("newer", r"state $q_t$", style.HISTORY)
    if particles.order > 1:
        older = particles.states[:, 1, 0]
        page.row("older", r"history $q_{t-1}$", style.HISTORY)
        some = style.sample(strengths, _LINES)
        lines = page.between(older[some], "older", newer[some], "newer")
        style.weighted_lines(page.axes, lines, strengths[some], style.HISTORY, 1.3, 1)
        _dots(page, older[shown], strengths[shown], "older", style.HISTORY)
    _dots(page, newer[shown], strengths[shown], "newer", style.HISTORY)
    page.note(page.heights["newer"], f"{len(particles)} particles", style.HISTORY)


def _dots(page: _Page, values: FloatArray, strengths: FloatArray, row: str, colour: str, marker: str = "o") -> None:
    style.weighted_points(page.axes, page.at(values, row), strengths, colour, _size(len(values)), 5, marker)


def _proposed(page: _Page, record: StepRecord, model: Model, proposes: bool) -> None:
    stage, strengths = proposal_stage(record), innovation_strengths(record)
    values = stage.particles.innovation[:, 0]
    shown = style.sample(strengths, _POINTS)
    label = r"$u_{t+1} \sim \pi$" if stage.proposal else r"$u_{t+1} \sim \pi, p$"
    page.row("proposed", label if proposes else r"$x \sim p(x\,|\,q_t)$", style.PROPOSAL)
    _dots(page, values[shown], strengths[shown], "proposed", style.PROPOSAL, "D")
    if proposes:
        density = stage.proposal or model.proposal(record.observation)
        log_density = density.log_density(page.grid[:, None])
        page.row("proposal", r"$\pi(u\,|\,y_{t+1})$", style.PROPOSAL)
        page.curve(np.exp(log_density - log_density.max()), "proposal", style.PROPOSAL, _CURVE)


def _joins(page: _Page, record: StepRecord) -> None:
    before, proposed = record.previous.states[:, 0, 0], proposal_stage(record).particles.innovation[:, 0]
    possible = possible_pairs(record)
    if possible is not None and len(possible.sources):
        lines = page.between(before[possible.sources], "newer", proposed[possible.targets], "proposed")
        style.weighted_lines(page.axes, lines, style.relative(possible.strengths), style.PROPOSAL, 2.4, 1)
    made = made_pairs(record)
    some = style.sample(made.strengths, _LINES)
    lines = page.between(before[made.sources[some]], "newer", proposed[made.targets[some]], "proposed")
    if possible is None:
        draw = style.arrows if len(some) <= _HEADS else style.weighted_lines
        draw(page.axes, lines, made.strengths[some], style.PROPOSAL, 1.6, 3)
    elif len(some) <= _HEADS:
        style.arrows(page.axes, lines, made.strengths[some], style.INK, 0.7, 3)
    middle = 0.5 * (page.heights["newer"] + page.heights["proposed"])
    page.note(middle, _how_joined(record, possible is not None), style.INK)


def _how_joined(record: StepRecord, chosen: bool) -> str:
    if chosen:
        return "every possible join\nby its probability,\narrow: the one drawn"
    if record.association is not None and record.association.arbitrary:
        return "joined by index,\nstrength: p(u | q),\ngrey: next to\nimpossible"
    drawn = "each drawn from\nits own state"
    return f"{drawn}:\nnothing was\nobserved" if is_missing(record.observation) else drawn


def _likelihood(page: _Page, record: StepRecord, model: Model) -> None:
    page.row("likelihood", r"$p(y_{t+1}\,|\,u)$", style.LIKELIHOOD)
    log_likelihood = model.log_likelihood(page.grid[:, None], record.observation)
    page.curve(np.exp(log_likelihood - log_likelihood.max()), "likelihood", style.LIKELIHOOD, _CURVE)


def _after(page: _Page, record: StepRecord, truth: FloatArray | None) -> None:
    new = outcome(record)
    known = new.histories >= 0
    older = record.previous.states[np.maximum(new.histories, 0), 0, 0]
    newer = new.particles.states[:, 0, 0]
    page.row("history", r"history $q_t$", style.POSTERIOR)
    page.row("state", r"state $q_{t+1}$", style.POSTERIOR)
    some = style.sample(new.strengths[known], _LINES)
    lines = page.between(older[known][some], "history", newer[known][some], "state")
    draw = style.arrows if len(some) <= _HEADS else style.weighted_lines
    draw(page.axes, lines, new.strengths[known][some], style.POSTERIOR, 2.0, 3)
    shown = style.sample(new.strengths, _POINTS)
    have = shown[known[shown]]
    _dots(page, older[have], new.strengths[have], "history", style.POSTERIOR)
    _dots(page, newer[shown], new.strengths[shown], "state", style.POSTERIOR)
    middle = 0.5 * (page.heights["history"] + page.heights["state"])
    page.note(middle, f"strength: weight\nESS {record.effective_sample_size:.1f}", style.POSTERIOR)
    if truth is not None:
        page.tick(float(truth[0]), "state", style.TRUTH, 0.22)


def _posterior(
    page: _Page, particles: ParticleSet, truth: FloatArray | None, exact: Gaussian | GridMarginal | None
) -> None:
    page.row("posterior", "posterior", style.POSTERIOR)
    densities = [smoothed_density(particles, page.grid)]
    if exact is not None:
        densities.append(np.exp(exact.log_density(page.grid[:, None])))
    peak = max(float(density.max()) for density in densities)
    page.curve(densities[0] / peak, "posterior", style.POSTERIOR, _POSTERIOR_CURVE)
    if exact is not None:
        page.curve(densities[1] / peak, "posterior", style.EXACT, _POSTERIOR_CURVE, dashed=True)
    page.tick(float(particles.mean[0]), "posterior", style.POSTERIOR, 0.17)
    if truth is not None:
        page.tick(float(truth[0]), "posterior", style.TRUTH, 0.27)
    _legend(page, particles, truth, exact)


def _legend(
    page: _Page, particles: ParticleSet, truth: FloatArray | None, exact: Gaussian | GridMarginal | None
) -> None:
    lines = [("particles", style.POSTERIOR)]
    if exact is not None:
        lines.append((f"exact, distance {total_variation(particles, exact):.2f}", style.EXACT))
    if truth is not None:
        lines.append(("truth", style.TRUTH))
    for number, (text, colour) in enumerate(lines):
        page.note(page.heights["posterior"] + 1.2 - 0.4 * number, text, colour)
