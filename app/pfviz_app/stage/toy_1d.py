"""The one-dimensional toy, after Figures 1 and 2 of the sources: one iteration, read from top to bottom."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from pfviz.exact import Gaussian, GridMarginal, smoothed_density, total_variation, total_variation_of_draws
from pfviz.figures.style import relative
from pfviz.particles import FloatArray, ParticleSet
from pfviz.record import StepRecord
from pfviz.worlds import ToyModel
from pfviz_app.picture import Pick, Picture
from pfviz_app.stage.ancestors import DEPTH, generations, line_of
from pfviz_app.stage.board import Board, arrow_heads
from pfviz_app.stage.layout import Rect
from pfviz_app.stage.lettering import fitted
from pfviz_app.stage.links import made_links, possible_links, sample_evenly
from pfviz_app.stage.palette import Palette, Rgb
from pfviz_app.stage.seen import Seen, likeliest_histories

_MOST_LINES = 250
_MOST_POINTS = 2000
_ROWS = {
    "older": 0.00,
    "newer": 0.10,
    "proposed": 0.40,
    "proposal": 0.50,
    "likelihood": 0.60,
    "history": 0.68,
    "state": 0.80,
    "posterior": 0.955,
}
_CURVE = 0.075
_STRIP = 0.3


class Toy1d:
    """Draws one step of a one-dimensional world into a rectangle."""

    def __init__(self, board: Board) -> None:
        self._board = board
        self._plot = Rect(0, 0, 1, 1)
        self._extent = 1.0
        self._gutter = 0.0

    def draw(self, rect: Rect, picture: Picture, palette: Palette) -> None:
        film = picture.toy.film
        self._gutter = 92.0 if rect.width > 330 else 4.0
        chosen = picture.chosen if picture.chosen and picture.chosen.room == "toy" else None
        family = picture.t > 1 and (picture.settings.ancestry or chosen is not None)
        strip = _STRIP * rect.height if family else 0.0
        self._plot, self._extent = rect.inset(self._gutter, 14, 6, 6 + strip), film.world.extent
        if picture.t == 0:
            self._start(picture.toy.trace.initial, palette)
            return
        record = picture.toy.trace[picture.t]
        model = picture.toy.outcome(picture.t).model
        assert isinstance(model, ToyModel)
        seen = Seen(record, picture.stage)
        self._before(record.previous, seen.before_strengths(), palette)
        self._proposed(seen, model, palette)
        if seen.joins():
            self._associations(record, picture.settings.arrows, palette)
        if seen.stage("weight"):
            self._likelihood(record, model, palette)
        self._after(seen, palette)
        if chosen:
            self._chosen(seen, chosen.index, palette)
        if seen.whole:
            self._posterior(record.posterior, picture, palette)
        if family:
            self._ancestors(rect.bottom - strip + 20, rect.bottom - 6, picture, chosen, palette)
        if picture.settings.truth and seen.whole:
            self._truth(float(film.truth(picture.t)[0]), palette)

    def place(self, x: float, y: float) -> FloatArray:
        """``(1,)``: the value that a pixel stands for, on every row the same; at most the edge of the picture."""
        value = 2.0 * (x - self._plot.x) / self._plot.width - 1.0
        return self._extent * np.clip([value], -1.0, 1.0)

    def pixel(self, place: FloatArray) -> tuple[float, float]:
        """Where a value can be taken hold of."""
        return float(self._x(place)[0]), self._y("state") + 22

    def _x(self, values: FloatArray) -> FloatArray:
        """Pixels of values of the world; what lies outside the picture is drawn at its edge."""
        inside = np.minimum(np.maximum(values / self._extent, -1.0), 1.0)
        return self._plot.x + self._plot.width * (0.5 + 0.5 * inside)

    def _y(self, row: str) -> float:
        return self._plot.y + self._plot.height * _ROWS[row]

    def _at(self, values: FloatArray, row: str) -> FloatArray:
        """``(n, 2)``: points in a row."""
        points = np.empty((len(values), 2))
        points[:, 0], points[:, 1] = self._x(values), self._y(row)
        return points

    def _between(self, upper: FloatArray, upper_row: str, lower: FloatArray, lower_row: str) -> FloatArray:
        """``(n, 2, 2)``: lines from row to row."""
        lines = np.empty((len(upper), 2, 2))
        for end, values, row in ((0, upper, upper_row), (1, lower, lower_row)):
            lines[:, end, 0], lines[:, end, 1] = self._x(values), self._y(row)
        return lines

    def _line(self, row: str, text: str, colour: Rgb, palette: Palette) -> None:
        """A row's axis, and its name in the colour of what lies on it."""
        y = self._y(row)
        self._board.rule(f"toy/line/{row}", self._plot.x, self._plot.right, y, palette.faint, -6.0)
        beside = self._gutter > 40
        self._board.text(
            f"toy/label/{row}",
            text,
            self._plot.x - self._gutter if beside else self._plot.x,
            y if beside else y - 9,
            colour,
        )

    def _start(self, particles: ParticleSet, palette: Palette) -> None:
        self._before(particles, relative(particles.weights), palette)
        x, y = self._plot.x + self._plot.width / 2, self._y("proposed")
        self._board.text("toy/hint", "the prior at t = 0: press Play or Step", x, y, palette.ink, "centre")

    def _before(self, particles: ParticleSet, strengths: FloatArray, palette: Palette) -> None:
        newer = particles.states[:, 0, 0]
        self._line("newer", "state qₜ", palette.history, palette)
        if particles.order > 1:
            older = particles.states[:, 1, 0]
            self._line("older", "history qₜ₋₁", palette.history, palette)
            some = sample_evenly(len(particles), _MOST_LINES)
            lines = self._between(older[some], "older", newer[some], "newer")
            self._board.weighted_segments("toy/pairs", lines, strengths[some], palette.history, -3.0)
            self._dots("toy/older", older, strengths, "older", palette.history)
        self._dots("toy/newer", newer, strengths, "newer", palette.history)

    def _dots(self, name: str, values: FloatArray, strengths: FloatArray, row: str, colour: Rgb) -> None:
        some = sample_evenly(len(values), _MOST_POINTS)
        size = float(np.clip(12.0 - 2.0 * np.log10(len(values) / 24.0), 6.0, 12.0))
        self._board.weighted_points(name, self._at(values[some], row), strengths[some], colour, size, 4.0)

    def _associations(self, record: StepRecord, count: int, palette: Palette) -> None:
        proposed, before = _proposed_values(record), record.previous.states[:, 0, 0]
        possible = possible_links(record, count)
        if len(possible.sources):
            lines = self._between(before[possible.sources], "newer", proposed[possible.targets], "proposed")
            self._board.weighted_segments("toy/possible", lines, possible.strengths, palette.faint, -5.0)
        made = made_links(record, min(count, _MOST_LINES))
        if len(made.sources):
            lines = self._between(before[made.sources], "newer", proposed[made.targets], "proposed")
            self._board.weighted_segments("toy/made", lines, made.strengths, palette.proposal, 0.0, palette.faint)
            if len(lines) <= 60:
                self._board.segments("toy/heads", arrow_heads(lines), palette.proposal, 1.2, 0.5)

    def _proposed(self, seen: Seen, model: ToyModel, palette: Palette) -> None:
        proposed = seen.proposed()
        if proposed is None:
            return
        values = proposed[0].innovation[:, 0]
        self._dots("toy/proposed", values, proposed[1], "proposed", palette.proposal)
        innovations, weighed = seen.of_innovations()
        self._board.target("toy", self._at(values[innovations], "proposed"), weighed)
        stage = seen.stage("propose")
        if stage is None:
            self._line("proposed", "x ~ p(x|qₜ)", palette.proposal, palette)
            return
        self._line("proposed", "u ~ π(u|y)", palette.proposal, palette)
        self._line("proposal", "π(u|y)", palette.proposal, palette)
        density = stage.proposal or model.proposal(seen.record.observation)
        heights = np.exp(density.log_density(self._grid[:, None]))
        self._curve("toy/proposal", heights / heights.max(), "proposal", palette.proposal)

    def _likelihood(self, record: StepRecord, model: ToyModel, palette: Palette) -> None:
        self._line("likelihood", "p(y|u)", palette.likelihood, palette)
        log_likelihood = model.log_likelihood(self._grid[:, None], record.observation)
        self._curve("toy/likelihood", np.exp(log_likelihood - log_likelihood.max()), "likelihood", palette.likelihood)
        seen = np.atleast_1d(record.observation).ravel()
        x, y = self._x(seen), self._y("likelihood")
        ticks = np.stack([np.stack([x, np.full(len(x), y - 5)], 1), np.stack([x, np.full(len(x), y + 5)], 1)], axis=1)
        self._board.segments("toy/observation", ticks, palette.likelihood, 3.0, 2.0)

    def _after(self, seen: Seen, palette: Palette) -> None:
        after = seen.after()
        if after is None:
            return
        particles, strengths = after.particles, after.strengths
        older = seen.record.previous.states[np.maximum(after.histories, 0), 0, 0]
        newer = particles.states[:, 0, 0]
        self._line("history", "history qₜ", palette.posterior, palette)
        self._line("state", "state qₜ₊₁", palette.posterior, palette)
        some = sample_evenly(len(particles), _MOST_LINES)
        lines = self._between(older[some], "history", newer[some], "state")
        self._board.weighted_segments("toy/new", lines, strengths[some], palette.posterior, 0.0)
        for values, row in ((older, "history"), (newer, "state")):
            self._board.target("toy", self._at(values, row), after.weighed)
        self._dots("toy/history", older, strengths, "history", palette.posterior)
        self._dots("toy/state", newer, strengths, "state", palette.posterior)

    def _chosen(self, seen: Seen, index: int, palette: Palette) -> None:
        """The particle that was clicked, through all rows, with the histories it could have had."""
        record, joins, after = seen.record, seen.joins(), seen.after()
        joined = np.flatnonzero(joins[2] == index)[:1] if joins else np.empty(0, np.int64)
        if joins is None or not len(joined):
            return
        before, proposed = record.previous.states[:, 0, 0], _proposed_values(record)[joins[1][joined]]
        rings = [self._at(proposed, "proposed")]
        found, probabilities = likeliest_histories(record, int(joined[0]), 12)
        if len(found):
            lines = self._between(before[found], "newer", np.repeat(proposed, len(found)), "proposed")
            self._board.weighted_segments("toy/chosen/row", lines, relative(probabilities), palette.chosen, 2.0)
        if after is not None:
            older = before[np.maximum(after.histories[joined], 0)]
            newer = after.particles.states[joined, 0, 0]
            rings += [self._at(older, "newer"), self._at(older, "history"), self._at(newer, "state")]
            line = self._between(older, "history", newer, "state")
            self._board.segments("toy/chosen/line", line, palette.chosen, 3.0, 5.0)
        self._board.points("toy/chosen", np.concatenate(rings), palette.chosen, 17.0, 3.0)

    def _ancestors(self, top: float, bottom: float, picture: Picture, chosen: Pick | None, palette: Palette) -> None:
        """Under the picture the time runs back: whom the particles descend from."""
        step = (bottom - top) / DEPTH

        def at(values: FloatArray, generation: ArrayLike) -> FloatArray:
            return np.stack(
                [self._x(values), np.broadcast_to(top + step * np.asarray(generation), len(values))], axis=1
            )

        for k, found in enumerate(generations(picture.toy, picture.t)):
            lines = np.stack([at(found.children[:, 0], k), at(found.parents[:, 0], k + 1)], axis=1)
            self._board.weighted_segments(f"toy/ancestors/{k}", lines, found.strengths, palette.history, -3.0)
        if chosen is not None:
            line = line_of(picture, chosen)[:, 0]
            self._board.polyline("toy/chosen/ancestors", at(line, np.arange(len(line))), palette.chosen, 3.0, 4.0)
        for k in (0, DEPTH // 2, DEPTH):
            if self._gutter > 40 and k < picture.t:
                text = f"qₜ₊₁ at t={picture.t}" if k == 0 else f"t={picture.t - k}"
                self._board.text(
                    f"toy/label/ancestors/{k}", text, self._plot.x - self._gutter, top + step * k, palette.history
                )

    def _posterior(self, particles: ParticleSet, picture: Picture, palette: Palette) -> None:
        assert picture.toy.exact is not None
        exact = picture.toy.exact.marginal(picture.t) if picture.settings.exact else None
        self._line("posterior", "posterior", palette.posterior, palette)
        smoothed = smoothed_density(particles, self._grid)
        curves = [("toy/posterior", smoothed, palette.posterior)]
        if exact is not None:
            density = np.exp(exact.log_density(self._grid[:, None]))
            curves.append(("toy/exact", density, palette.exact))
        peak = max(float(curve.max()) for _, curve, _ in curves)
        for name, curve, colour in curves:
            self._curve(name, curve / max(peak, 1e-300), "posterior", colour, 0.13)
        if picture.settings.exact:
            base = self._y("posterior")
            x, y = self._plot.x + self._plot.width / 2, base + min(max(self._plot.bottom - 1 - base, 15), 21)
            text = fitted(distance_text(particles, exact), 11.0, self._plot.width)
            self._board.text("toy/distance", text, x, y, palette.ink, "centre", 11.0)
        self._ticks("toy/estimate", float(particles.mean[0]), palette.posterior, posterior=9)

    def _truth(self, value: float, palette: Palette) -> None:
        self._ticks("toy/truth", value, palette.truth, posterior=13, state=9)

    def _ticks(self, name: str, value: float, colour: Rgb, **reaches: float) -> None:
        """A value on some rows, so far up and down from each."""
        x = float(self._x(np.array([value]))[0])
        ticks = [[[x, self._y(row) - reach], [x, self._y(row) + reach]] for row, reach in reaches.items()]
        self._board.segments(name, ticks, colour, 3.5, 8.0)

    @cached_property
    def _grid(self) -> FloatArray:
        return np.linspace(-self._extent, self._extent, 121)

    def _curve(self, name: str, heights: FloatArray, row: str, colour: Rgb, reach: float = _CURVE) -> None:
        """A curve of ``heights`` from 0 to 1 that stands on a row."""
        y = self._y(row) - self._plot.height * reach * heights
        self._board.polyline(name, np.stack([self._x(self._grid), y], axis=1), colour, 2.2, 1.0)


def distance_text(particles: ParticleSet, exact: Gaussian | GridMarginal | None) -> str:
    """How far the particles are from the exact posterior, or that there is none."""
    if exact is None:
        return "no exact answer here"
    of_draws = total_variation_of_draws(len(particles), particles.dimension)
    return f"distance to exact {total_variation(particles, exact):.2f} (exact draws: {of_draws:.2f})"


def _proposed_values(record: StepRecord) -> FloatArray:
    proposed = Seen(record).proposed()
    return (proposed[0] if proposed else record.posterior).innovation[:, 0]
