"""The curves under the picture: effective sample size and error over time."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, cast

import numpy as np
import viser
from viser import uplot

from pfviz.particles import FloatArray
from pfviz_app.picture import Picture
from pfviz_app.room import Room
from pfviz_app.settings import Settings
from pfviz_app.stage.palette import DARK, LIGHT, Rgb

_PERIOD = 0.25
_MOST_POINTS = 400
_ROUND = 200


class Plots:
    """Two small charts with a line for each room, redrawn a few times a second at the most."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self._shown: tuple[int, int, Settings] | None = None
        self._drawn_at = 0.0
        self._ess = _Chart(client, "effective sample size, % of N", "y")
        self._error = _Chart(client, "error: toy (left), video in px (right)", "px")

    def draw(self, picture: Picture) -> None:
        """Show the rooms' records, unless nothing has changed or it is too soon."""
        now, state = time.monotonic(), (id(picture.toy), picture.last, picture.settings)
        if state == self._shown or (picture.playing and now - self._drawn_at < _PERIOD):
            return
        self._shown, self._drawn_at = state, now
        self._ess.draw(picture, _relative_ess)
        self._error.draw(picture, lambda room: room.errors)


class _Chart:
    """A chart over time with the toy's line and, where there is anything to show, the tracker's."""

    def __init__(self, client: viser.ClientHandle, title: str, video_scale: str) -> None:
        self._video_scale = video_scale
        self._style: tuple[bool, bool] | None = None
        nothing = np.array([0.0, 1.0])
        self._plot = client.gui.add_uplot(
            (nothing, nothing),
            (uplot.Series(label="t"), uplot.Series(label="toy", show=False)),
            title=title,
            scales={"x": {"time": False}},
            height=128,
            legend=uplot.Legend(show=False),
            padding=(8, 8, 0, 0),
        )

    def draw(self, picture: Picture, values: Callable[[Room[Any]], FloatArray]) -> None:
        times = np.arange(1.0, _reach(picture) + 1.0)
        toy, video = (_line(room, values(room), len(times)) for room in (picture.toy, picture.tracker))
        known = bool(np.isfinite(video).any())
        thin = slice(None, None, len(times) // _MOST_POINTS + 1)
        lines = (toy, video) if known else (toy,)
        style = (picture.settings.dark, known)
        if style != self._style:
            self._style = style
            self._plot.series = self._series(*style)
            self._plot.axes = self._axes(*style)
        self._plot.data = (times[thin], *(line[thin] for line in lines))

    def _series(self, dark: bool, video: bool) -> tuple[uplot.Series, ...]:
        palette = DARK if dark else LIGHT
        toy = _stroke("toy", palette.history, "y")
        tracker = _stroke("video", palette.posterior, self._video_scale)
        return (uplot.Series(label="t"), toy, tracker) if video else (uplot.Series(label="t"), toy)

    def _axes(self, dark: bool, video: bool) -> tuple[uplot.Axis, ...]:
        palette = DARK if dark else LIGHT
        across = _axis(None, palette.ink, palette.faint, size=26)
        if not video or self._video_scale == "y":
            return across, _axis("y", palette.ink, palette.faint)
        right = _axis("px", palette.posterior, None)
        right["side"] = 1
        return across, _axis("y", palette.history, palette.faint), right


def _reach(picture: Picture) -> int:
    """The last time of the x-axis: the film's, or a round number beyond what is recorded.

    It changes rarely: each time it does, the browser must work out its zoom anew.
    """
    length = picture.tracker.film.length
    if length is not None and 2 <= length <= _MOST_POINTS:
        return length
    return max(_ROUND * -(-picture.last // _ROUND), _ROUND)


def _axis(scale: str | None, ink: Rgb, grid: Rgb | None, size: int = 34) -> uplot.Axis:
    """An axis whose numbers are in the colour of what they belong to."""
    lines = {"show": False} if grid is None else {"stroke": _css(grid), "width": 1}
    style = {"stroke": _css(ink), "grid": lines, "size": size, "font": "11px sans-serif", "ticks": {"show": False}}
    return cast(uplot.Axis, style if scale is None else style | {"scale": scale})


def _stroke(label: str, colour: Rgb, scale: str) -> uplot.Series:
    style = {"label": label, "stroke": _css(colour), "width": 2, "points": {"show": False}, "scale": scale}
    return cast(uplot.Series, style)


def _line(room: Room[Any], known: FloatArray, length: int) -> FloatArray:
    """``(length,)``: the values known, at their times; NaN elsewhere."""
    line = np.full(length, np.nan)
    first = room.trace.first - 1
    stop = min(first + len(known), length)
    line[first:stop] = known[: stop - first]
    return line


def _relative_ess(room: Room[Any]) -> FloatArray:
    sizes = np.array([len(record.posterior) for record in room.trace])
    return 100.0 * room.effective_sample_sizes / sizes


def _css(colour: Rgb) -> str:
    return "#{:02x}{:02x}{:02x}".format(*colour)
