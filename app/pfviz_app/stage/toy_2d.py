"""The two-dimensional toy: the rows of the one-dimensional one as floors of a house, with arrows from floor to floor.

The floors are real planes, tilted: orbit the camera and look at them from the side.
"""

from __future__ import annotations

import numpy as np

from pfviz.exact import Gaussian
from pfviz.figures.style import relative
from pfviz.particles import FloatArray, ParticleSet
from pfviz.record import StepRecord
from pfviz.worlds import ToyModel
from pfviz_app.picture import Picture
from pfviz_app.stage.ancestors import generations, line_of
from pfviz_app.stage.board import Board, arrow_heads
from pfviz_app.stage.layout import Rect
from pfviz_app.stage.lettering import fitted
from pfviz_app.stage.links import made_links, possible_links, sample_evenly
from pfviz_app.stage.palette import Palette, Rgb
from pfviz_app.stage.seen import Seen, likeliest_histories
from pfviz_app.stage.toy_1d import distance_text

_MOST_LINES = 250
_MOST_POINTS = 2000
_TILT = np.deg2rad(34.0)
_FLOORS = {"before": 0.16, "proposed": 0.50, "after": 0.84}
_CIRCLE = np.stack([np.cos(np.linspace(0, 2 * np.pi, 41)), np.sin(np.linspace(0, 2 * np.pi, 41))], axis=1)


class Toy2d:
    """Draws one step of a two-dimensional world into a rectangle."""

    def __init__(self, board: Board) -> None:
        self._board = board
        self._plot = Rect(0, 0, 1, 1)
        self._unit = self._extent = 1.0

    def draw(self, rect: Rect, picture: Picture, palette: Palette) -> None:
        film = picture.toy.film
        self._plot = rect.inset(6, 10, 6, 6)
        across = self._plot.width / (2.0 * film.world.extent)
        floor = 0.30 * self._plot.height / (2.0 * film.world.extent * np.sin(_TILT))
        self._unit, self._extent = min(across, floor), film.world.extent
        if picture.t == 0:
            initial = picture.toy.trace.initial
            self._before(initial, relative(initial.weights), film.world.extent, palette)
            self._board.text(
                "toy/hint", "the prior at t = 0: press Play or Step", *self._plot.centre, palette.ink, "centre"
            )
            return
        record = picture.toy.trace[picture.t]
        model = picture.toy.outcome(picture.t).model
        assert isinstance(model, ToyModel)
        seen = Seen(record, picture.stage)
        self._before(record.previous, seen.before_strengths(), film.world.extent, palette)
        self._proposed(seen, model, film.world.extent, palette)
        if seen.joins():
            self._associations(record, picture.settings.arrows, palette)
        self._after(seen, film.world.extent, palette)
        if picture.chosen and picture.chosen.room == "toy":
            self._chosen(seen, picture.chosen.index, palette)
        if picture.t > 1 and (picture.settings.ancestry or (picture.chosen and picture.chosen.room == "toy")):
            self._ancestors(picture, palette)
        if seen.whole and picture.settings.exact:
            self._exact(record.posterior, picture, palette)
        if seen.whole and picture.settings.truth:
            self._truth(film.truth(picture.t), palette)

    def place(self, x: float, y: float) -> FloatArray:
        """``(2,)``: the place on the last floor that a pixel stands for, at most its edge."""
        across = (x - self._plot.centre[0]) / self._unit
        rise = (self._plot.y + self._plot.height * _FLOORS["after"] - y) / (self._unit * np.sin(_TILT))
        return np.clip([across, rise], -self._extent, self._extent)

    def pixel(self, place: FloatArray) -> tuple[float, float]:
        """Where a place can be taken hold of."""
        x, y, _ = self._at(place, "after")
        return float(x), float(y)

    def _at(self, values: FloatArray, floor: str) -> FloatArray:
        """``(..., 3)``: pixels and depth of points ``(..., 2)`` of the world on a floor."""
        x = self._plot.centre[0] + self._unit * values[..., 0]
        rise = self._unit * values[..., 1]
        y = self._plot.y + self._plot.height * _FLOORS[floor] - rise * np.sin(_TILT)
        return np.stack([x, y, -rise * np.cos(_TILT)], axis=-1)

    def _floor(self, floor: str, text: str, colour: Rgb, extent: float, palette: Palette) -> None:
        corners = extent * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        placed = self._at(corners, floor)
        self._board.polyline(f"toy/floor/{floor}", placed, palette.faint, 1.2, -4.0, closed=True)
        text = fitted(text, 12.5, self._plot.width)
        self._board.text(f"toy/label/{floor}", text, placed[3, 0], placed[3, 1] - 9, colour)

    def _before(self, particles: ParticleSet, strengths: FloatArray, extent: float, palette: Palette) -> None:
        self._floor("before", "states qₜ, with their histories qₜ₋₁", palette.history, extent, palette)
        older = particles.states[:, min(1, particles.order - 1)]
        self._tailed("toy/before", particles.innovation, older, strengths, "before", palette.history)

    def _tailed(
        self, name: str, newer: FloatArray, older: FloatArray, strengths: FloatArray, floor: str, colour: Rgb
    ) -> None:
        """Particles on a floor, each with a tail from where it was a step ago."""
        some = sample_evenly(len(newer), _MOST_LINES)
        tails = np.stack([self._at(older[some], floor), self._at(newer[some], floor)], axis=1)
        self._board.weighted_segments(f"{name}/tails", tails, strengths[some], colour, 0.0)
        self._dots(name, newer, strengths, floor, colour)

    def _dots(self, name: str, values: FloatArray, strengths: FloatArray, floor: str, colour: Rgb) -> None:
        some = sample_evenly(len(values), _MOST_POINTS)
        size = float(np.clip(10.0 - 2.0 * np.log10(len(values) / 24.0), 5.0, 10.0))
        self._board.weighted_points(name, self._at(values[some], floor), strengths[some], colour, size, 4.0)

    def _associations(self, record: StepRecord, count: int, palette: Palette) -> None:
        before = self._at(record.previous.innovation, "before")
        proposed = self._at(_proposed(record), "proposed")
        possible = possible_links(record, count)
        if len(possible.sources):
            lines = np.stack([before[possible.sources], proposed[possible.targets]], axis=1)
            self._board.weighted_segments("toy/possible", lines, possible.strengths, palette.faint, -5.0)
        made = made_links(record, min(count, _MOST_LINES))
        if len(made.sources):
            lines = np.stack([before[made.sources], proposed[made.targets]], axis=1)
            self._board.weighted_segments("toy/made", lines, made.strengths, palette.proposal, 0.0, palette.faint)
            if len(lines) <= 60:
                self._board.segments("toy/heads", arrow_heads(lines[..., :2]), palette.proposal, 1.2, 0.5)

    def _proposed(self, seen: Seen, model: ToyModel, extent: float, palette: Palette) -> None:
        proposed = seen.proposed()
        if proposed is None:
            return
        self._dots("toy/proposed", proposed[0].innovation, proposed[1], "proposed", palette.proposal)
        innovations, weighed = seen.of_innovations()
        self._board.target("toy", self._at(proposed[0].innovation[innovations], "proposed"), weighed)
        if seen.stage("propose") is None:
            self._floor("proposed", "x ~ p(x|qₜ)", palette.proposal, extent, palette)
        else:
            self._floor("proposed", "innovations u, drawn from π(u|y)", palette.proposal, extent, palette)
            detector = model.proposal(seen.record.observation)
            bumps = [detector.covariance * s**2 for s in (1.0, 2.0)]
            rings = [ellipse(Gaussian(mean, c)) for mean in detector.means for c in bumps]
            self._board.polyline("toy/proposal", self._at(np.array(rings), "proposed"), palette.proposal, 1.5)
        detections = np.atleast_2d(seen.record.observation)
        crosses = self._at(np.concatenate([detections + 0.09 * _CIRCLE[[i]] for i in (5, 15, 25, 35)]), "proposed")
        n = len(detections)
        lines = np.concatenate([np.stack([crosses[i * n :][:n], crosses[(i + 2) * n :][:n]], axis=1) for i in (0, 1)])
        self._board.segments("toy/observation", lines, palette.likelihood, 3.0, 6.0)

    def _after(self, seen: Seen, extent: float, palette: Palette) -> None:
        after = seen.after()
        if after is None:
            return
        self._floor("after", "new states qₜ₊₁, strength = weight", palette.posterior, extent, palette)
        older, newer = seen.record.previous.innovation[np.maximum(after.histories, 0)], after.particles.innovation
        self._tailed("toy/after", newer, older, after.strengths, "after", palette.posterior)
        self._board.target("toy", self._at(newer, "after"), after.weighed)
        if seen.whole:
            self._cross("toy/estimate", seen.record.estimate, palette.posterior)

    def _chosen(self, seen: Seen, index: int, palette: Palette) -> None:
        """The particle that was clicked, on all floors, with the histories it could have had."""
        record, joins, after = seen.record, seen.joins(), seen.after()
        joined = np.flatnonzero(joins[2] == index)[:1] if joins else np.empty(0, np.int64)
        if joins is None or not len(joined):
            return
        proposed = self._at(_proposed(record)[joins[1][joined]], "proposed")
        before = self._at(record.previous.innovation, "before")
        rings = [proposed]
        found, probabilities = likeliest_histories(record, int(joined[0]), 12)
        if len(found):
            lines = np.stack([before[found], np.repeat(proposed, len(found), axis=0)], axis=1)
            self._board.weighted_segments("toy/chosen/row", lines, relative(probabilities), palette.chosen, 2.0)
        if after is not None:
            rings.append(before[np.maximum(after.histories[joined], 0)])
            rings.append(self._at(after.particles.innovation[joined], "after"))
        self._board.points("toy/chosen", np.concatenate(rings), palette.chosen, 15.0, 3.0)

    def _ancestors(self, picture: Picture, palette: Palette) -> None:
        """On the last floor: whom the particles descend from, and of whom the one that was clicked."""
        if picture.settings.ancestry:
            for k, found in enumerate(generations(picture.toy, picture.t)):
                lines = np.stack([self._at(found.children, "after"), self._at(found.parents, "after")], axis=1)
                self._board.weighted_segments(f"toy/ancestors/{k}", lines, found.strengths, palette.history, -1.0)
        if picture.chosen and picture.chosen.room == "toy":
            line = self._at(line_of(picture, picture.chosen), "after")
            if len(line) > 1:
                self._board.polyline("toy/chosen/ancestors", line, palette.chosen, 3.0, 5.0)

    def _exact(self, particles: ParticleSet, picture: Picture, palette: Palette) -> None:
        """Two standard deviations of the exact posterior, and how far the particles are from it."""
        exact = picture.toy.exact.marginal(picture.t) if picture.toy.exact else None
        if isinstance(exact, Gaussian):
            curve = ellipse(Gaussian(exact.mean, 4.0 * exact.covariance))
            self._board.polyline("toy/exact", self._at(curve, "after"), palette.exact, 2.0, 6.0)
        x, y = self._plot.centre[0], self._plot.bottom - 4
        text = fitted(distance_text(particles, exact), 11.0, self._plot.width)
        self._board.text("toy/distance", text, x, y, palette.ink, "centre", 11.0)

    def _truth(self, value: FloatArray, palette: Palette) -> None:
        self._cross("toy/truth", value, palette.truth)

    def _cross(self, name: str, value: FloatArray, colour: Rgb) -> None:
        x, y, depth = self._at(value, "after")
        ticks = [[[x - 8, y, depth], [x + 8, y, depth]], [[x, y - 8, depth], [x, y + 8, depth]]]
        self._board.segments(name, ticks, colour, 3.5, 9.0)


def ellipse(gaussian: Gaussian) -> FloatArray:
    """``(41, 2)``: the curve one standard deviation from the mean of a two-dimensional Gaussian."""
    return gaussian.mean + _CIRCLE @ np.linalg.cholesky(gaussian.covariance).T


def _proposed(record: StepRecord) -> FloatArray:
    proposed = Seen(record).proposed()
    return (proposed[0] if proposed else record.posterior).innovation
