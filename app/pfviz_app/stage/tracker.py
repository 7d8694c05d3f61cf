"""The tracker, after Figure 3 of the sources: the whole frame, and a close-up that follows the estimate."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pfviz.particles import FloatArray
from pfviz.record import StepRecord
from pfviz.vision.shapes import apply, transforms
from pfviz.vision.tracker import TrackerModel, TrackEstimate
from pfviz.vision.video import Image
from pfviz_app.films import Point
from pfviz_app.picture import Picture
from pfviz_app.stage.ancestors import generations, line_of
from pfviz_app.stage.board import Board, arrow_heads
from pfviz_app.stage.layout import Rect
from pfviz_app.stage.links import sample_evenly
from pfviz_app.stage.palette import LIGHT, Palette, Rgb
from pfviz_app.stage.seen import After, Seen

_CONTOURS = 14
_MOST_POINTS = 1000
_DARK, _BRIGHT = (10, 10, 14), (255, 255, 255)
_ON_IMAGE = LIGHT
_WEAK = (222, 224, 226)
_EDGES = (240, 228, 66)
_CLOSE_UP_PIXELS = 420


class Window:
    """A part of the frame shown in a rectangle of the canvas."""

    def place(self, x: float, y: float) -> Point | None:
        """The frame pixel that a pixel of the canvas shows; None outside."""
        if not self.rect.holds(x, y):
            return None
        return self._part.x + (x - self.rect.x) / self.scale, self._part.y + (y - self.rect.y) / self.scale

    def __init__(self, rect: Rect, part: Rect) -> None:
        self.rect = rect
        self.scale = rect.width / part.width
        self._part = part

    def __call__(self, points: FloatArray) -> FloatArray:
        """Canvas pixels of frame pixels ``(..., 2)``."""
        corner = np.array([self._part.x, self._part.y])
        return (points - corner) * self.scale + np.array([self.rect.x, self.rect.y])

    def holds(self, points: FloatArray) -> NDArray[np.bool_]:
        """Whether frame pixels ``(n, 2)`` lie in the window."""
        p = self._part
        x, y = points[:, 0], points[:, 1]
        return (x >= p.x) & (x <= p.right) & (y >= p.y) & (y <= p.bottom)


class TrackerStage:
    """Draws one step of the tracker into a rectangle."""

    def __init__(self, board: Board) -> None:
        self._board = board
        self._windows: tuple[Window, ...] = ()

    def place(self, x: float, y: float) -> Point | None:
        """The frame pixel that a pixel of the canvas shows; None where it shows none."""
        return next((place for window in self._windows if (place := window.place(x, y))), None)

    def draw(self, rect: Rect, picture: Picture, palette: Palette) -> None:
        film, t = picture.tracker.film, picture.t
        width, height = film.source.size
        image = film.image(max(t, 1))
        whole = Window(self._frame_rect(rect, width / height), Rect(0, 0, width, height))
        self._windows = (whole,)
        self._board.image("tracker/frame", _shrunk(image), whole.rect)
        if picture.outline:
            self._clicked(picture.outline, whole)
        if t == 0:
            if not film.setup.model.searching:
                self._outline("tracker/frame/expected", whole, film.setup.model, film.setup.model.start, palette)
            return
        model = picture.tracker.outcome(t).model
        assert isinstance(model, TrackerModel)
        record = picture.tracker.trace[t]
        estimate = film.estimate(record)
        close = self._close_up(rect, whole.rect, estimate, image, palette)
        self._windows = (whole, close)
        seen = Seen(record, picture.stage)
        if picture.settings.overlay != "none":
            self._overlay(picture.settings.overlay, record.observation, whole)
        self._border(close, whole, palette)
        self._proposed(seen, whole)
        after = seen.after()
        if after is not None:
            self._likely(after, model, close)
            self._centres(record, after, close, picture.settings.arrows)
            self._ancestors(picture, whole, close)
            if picture.chosen and picture.chosen.room == "tracker":
                self._chosen(after, picture.chosen.index, model, close)
                self._normals(after, picture.chosen.index, model, record.observation, close)
        if not seen.whole:
            return
        for name, window in (("frame", whole), ("close", close)):
            self._outline(f"tracker/{name}/expected", window, model, estimate.state, palette)
        truth = film.truth(t)
        if truth is not None and picture.settings.truth:
            self._truth(truth, close)

    def _frame_rect(self, rect: Rect, aspect: float) -> Rect:
        return Rect(rect.x, rect.y, rect.width, 0.46 * rect.height).fitted(aspect)

    def _close_up(self, rect: Rect, frame: Rect, estimate: TrackEstimate, image: Image, palette: Palette) -> Window:
        below = Rect(rect.x, frame.bottom + 14, rect.width, max(rect.bottom - frame.bottom - 14, 40))
        aspect = float(np.clip(below.width / below.height, 0.8, 1.6))
        target = below.fitted(aspect)
        reach = 0.9 * max(estimate.box[2], estimate.box[3] * aspect, 16.0)
        part = Rect(estimate.x - reach, estimate.y - reach / aspect, 2 * reach, 2 * reach / aspect)
        self._board.image("tracker/close", _cut_out(image, part, palette.background), target)
        return Window(target, part)

    def _border(self, close: Window, whole: Window, palette: Palette) -> None:
        """Where in the frame the close-up lies."""
        p = close._part
        corners = whole(np.array([[p.x, p.y], [p.right, p.y], [p.right, p.bottom], [p.x, p.bottom]]))
        corners = np.clip(corners, [whole.rect.x, whole.rect.y], [whole.rect.right, whole.rect.bottom])
        self._board.polyline("tracker/frame/part", corners, palette.posterior, 2.0, 2.0, closed=True)

    def _proposed(self, seen: Seen, whole: Window) -> None:
        """Where in the frame hypotheses were proposed: by the detector, or by the dynamics."""
        proposed = seen.proposed()
        if proposed is None:
            return
        centres = proposed[0].innovation[:, :2]
        centres = centres[whole.holds(centres)]
        centres = whole(centres[sample_evenly(len(centres), _MOST_POINTS)])
        self._board.points("tracker/frame/proposed/rim", centres, _DARK, 5.0, 1.0)
        self._board.points("tracker/frame/proposed", centres, _ON_IMAGE.proposal, 3.4, 1.5)

    def _likely(self, after: After, model: TrackerModel, close: Window) -> None:
        """The contours of likely particles, dark on a bright rim."""
        order = np.argsort(-after.strengths, kind="stable")[:_CONTOURS]
        likely = order[after.strengths[order] > 0.05]
        outlines = close(model.contour.outlines(after.particles.innovation[likely], per_segment=2))
        inside = self._inside(outlines, close)
        likely, outlines = likely[inside], outlines[inside]
        if len(outlines):
            corners = outlines.reshape(-1, 2)
            self._board.target("tracker", corners, np.repeat(after.weighed[likely], outlines.shape[1]))
            self._board.polyline("tracker/close/rims", outlines, (225, 225, 225), 2.6, 1.0, closed=True)
            self._board.polyline("tracker/close/likely", outlines, _DARK, 1.3, 2.0, closed=True)

    @staticmethod
    def _inside(outlines: FloatArray, window: Window) -> NDArray[np.bool_]:
        r = window.rect
        low, high = outlines.min(axis=1), outlines.max(axis=1)
        return (low[:, 0] >= r.x) & (low[:, 1] >= r.y) & (high[:, 0] <= r.right) & (high[:, 1] <= r.bottom)

    def _centres(self, record: StepRecord, after: After, close: Window, arrows: int) -> None:
        """Where the particles are, with arrows from where their histories were."""
        particles, histories, weights = after.particles, after.histories, after.strengths
        centres = particles.innovation[:, :2]
        shown = np.flatnonzero(close.holds(centres))
        shown = shown[sample_evenly(len(shown), _MOST_POINTS)]
        if not len(shown):
            return
        self._board.target("tracker", close(centres[shown]), after.weighed[shown])
        size = float(np.clip(9.0 - 1.5 * np.log10(len(particles) / 100.0), 4.5, 9.0))
        green, blue = _ON_IMAGE.posterior, _ON_IMAGE.history
        self._board.weighted_points(
            "tracker/close/centres", close(centres[shown]), weights[shown], green, size, 6.0, _WEAK
        )
        drawn = shown[histories[shown] >= 0]
        before = record.previous.innovation[histories[drawn], :2]
        drawn, before = drawn[close.holds(before)], before[close.holds(before)]
        order = np.argsort(-weights[drawn])[: min(arrows, 120)]
        if not len(order):
            return
        lines = np.stack([close(before[order]), close(centres[drawn[order]])], axis=1)
        self._board.weighted_segments("tracker/close/arrows", lines, weights[drawn[order]], blue, 3.0, _WEAK)
        if len(lines) <= 40:
            self._board.segments("tracker/close/heads", arrow_heads(lines, 6.0), blue, 1.2, 4.0)

    def _chosen(self, after: After, index: int, model: TrackerModel, close: Window) -> None:
        """The outline of the particle that was clicked, and its centre."""
        drawn = np.flatnonzero(after.weighed == index)[:1]
        if len(drawn):
            states, colour = after.particles.innovation[drawn], _ON_IMAGE.chosen
            outlines = close(model.contour.outlines(states))
            self._board.polyline("tracker/chosen", outlines, colour, 2.6, 10.0, closed=True)
            self._board.points("tracker/chosen/centre", close(states[:, :2]), colour, 12.0, 5.0)

    def _normals(self, after: After, index: int, model: TrackerModel, seen: Any, close: Window) -> None:
        """The normals of the outline that was clicked, and the edges that were found along them."""
        likelihood, drawn = model.contour_likelihood, np.flatnonzero(after.weighed == index)[:1]
        if likelihood is None or not len(drawn):
            return
        scale = model.extractor.working_scale
        states = after.particles.innovation[drawn]
        offsets = likelihood.edge_offsets(transforms(states, scale), seen.edge_map)[0]
        placing = transforms(states)
        points, along = apply(placing, model.contour.points)[0], _normals_put(placing[0], model.contour.normals) / scale
        reach = likelihood.search
        ends = np.stack([close(points - reach * along), close(points + reach * along)], axis=1)
        self._board.segments("tracker/chosen/normals", ends, _BRIGHT, 1.2, 9.0)
        found = offsets <= reach
        edges = close(points[found] + offsets[found, None] * along[found])
        self._board.points("tracker/chosen/edges", edges, _ON_IMAGE.proposal, 7.0, 11.0)

    def _ancestors(self, picture: Picture, whole: Window, close: Window) -> None:
        """The way that the ancestors have come: of all particles, and of the one that was clicked."""
        if picture.settings.ancestry:
            for k, found in enumerate(generations(picture.tracker, picture.t)):
                ends = np.stack([found.children[:, :2], found.parents[:, :2]], axis=1)
                for name, window in (("frame", whole), ("close", close)):
                    inside = window.holds(ends[:, 0]) & window.holds(ends[:, 1])
                    lines, strengths = window(ends[inside]), found.strengths[inside]
                    self._board.weighted_segments(
                        f"tracker/{name}/ancestors/{k}", lines, strengths, _ON_IMAGE.history, 2.5, _WEAK
                    )
        if picture.chosen and picture.chosen.room == "tracker":
            line = line_of(picture, picture.chosen)[:, :2]
            for name, window in (("frame", whole), ("close", close)):
                inside = line[window.holds(line)]
                if len(inside) > 1:
                    self._board.polyline(
                        f"tracker/{name}/chosen/ancestors", window(inside), _ON_IMAGE.chosen, 3.0, 10.0
                    )

    def _clicked(self, outline: tuple[Point, ...], whole: Window) -> None:
        """The corners clicked so far."""
        corners = whole(np.array(outline))
        self._board.polyline("tracker/outline", corners, _ON_IMAGE.chosen, 2.4, 12.0, closed=len(corners) > 2)
        self._board.points("tracker/outline/corners", corners, _ON_IMAGE.chosen, 8.0, 13.0)

    def _overlay(self, kind: str, seen: Any, whole: Window) -> None:
        """What the detector sees, or the edges, over the whole frame."""
        if kind == "proposal":
            cells = seen.proposal.density
            strength = (cells / cells.max()) ** 0.25
            colour = _ON_IMAGE.proposal
        else:
            strength, colour = seen.edges.astype(float), _EDGES
        layer = np.empty((*strength.shape, 4), np.uint8)
        layer[..., :3] = colour[::-1]
        layer[..., 3] = np.rint(225.0 * strength)
        self._board.image(f"tracker/frame/{kind}", layer, whole.rect, -9.0)

    def _outline(self, name: str, window: Window, model: TrackerModel, state: FloatArray, palette: Palette) -> None:
        """The expected contour: white with a dark rim, or one in the colour of the filter that is compared with."""
        outline = window(model.contour.outlines(state))
        rim = LIGHT.rival if palette.posterior == palette.rival else _DARK
        self._board.polyline(f"{name}/rim", outline, rim, 4.6, 8.0, closed=True)
        self._board.polyline(name, outline, _BRIGHT, 2.4, 9.0, closed=True)

    def _truth(self, truth: TrackEstimate, close: Window) -> None:
        centre = np.array([[truth.x, truth.y]])
        if close.holds(centre)[0]:
            x, y = close(centre)[0]
            ticks = [[[x - 9, y], [x + 9, y]], [[x, y - 9], [x, y + 9]]]
            self._board.segments("tracker/close/truth", ticks, _ON_IMAGE.truth, 3.5, 12.0)


def _normals_put(matrix: FloatArray, normals: FloatArray) -> FloatArray:
    """``(L, 2)``: where ``normals (L, 2)`` of an outline point, at unit length, when ``matrix (2, 3)`` has put it.

    A map that shears does not keep right angles: normals go by its cofactors.
    """
    (a, b), (d, e) = matrix[:, :2]
    along = normals @ np.array([[e, -b], [-d, a]])
    return along / np.linalg.norm(along, axis=1, keepdims=True)


def _shrunk(image: Image) -> Image:
    """The frame, at most 640 pixels wide."""
    shrink = min(1.0, 640.0 / image.shape[1])
    if shrink == 1.0:
        return image
    return cv2.resize(image, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)


def _cut_out(image: Image, part: Rect, outside: Rgb) -> Image:
    """A part of the frame, at most twice as large: the page smooths what is larger still."""
    zoom = min(_CLOSE_UP_PIXELS / part.width, 2.0)
    width, height = max(round(part.width * zoom), 1), max(round(part.height * zoom), 1)
    across, down = width / part.width, height / part.height
    placing = np.array([[across, 0.0, -part.x * across - 0.5], [0.0, down, -part.y * down - 0.5]])
    cut = cv2.warpAffine(image, placing, (width, height), flags=cv2.INTER_LINEAR, borderValue=outside[::-1])
    return cut.astype(np.uint8, copy=False)
