"""The curves under the picture: effective sample size and error over time."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray
from viser import uplot

from pfviz_app.session import Picture
from pfviz_app.stage.palette import DARK, LIGHT, Rgb

_PERIOD = 0.25
_MOST_POINTS = 400


class Plots:
    """Two small charts with a line for each room, redrawn a few times a second at the most."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self._client = client
        self._last: tuple[int, int, bool] | None = None
        self._drawn_at = 0.0
        self._ess = self._chart("ESS, % of N")
        self._error = self._chart("error")

    def _chart(self, title: str) -> viser.GuiUplotHandle:
        empty = np.array([0.0, 1.0])
        return self._client.gui.add_uplot(
            (empty, np.full(2, np.nan), np.full(2, np.nan)),
            _series(False),
            title=title,
            scales={"x": {"time": False}},
            axes=_axes(False),
            height=135,
            legend=uplot.Legend(show=False),
            padding=(8, 12, 0, 0),
        )

    def draw(self, picture: Picture) -> None:
        """Show the rooms' records, unless nothing has changed or it is too soon."""
        now, key = time.monotonic(), (id(picture.toy), picture.last, picture.settings.dark)
        changed = self._last is None or key != self._last
        if not changed and not picture.playing:
            return
        if picture.playing and now - self._drawn_at < _PERIOD:
            return
        if self._last is None or self._last[2] != picture.settings.dark:
            for chart in (self._ess, self._error):
                chart.series = _series(picture.settings.dark)
                chart.axes = _axes(picture.settings.dark)
        self._last, self._drawn_at = key, now
        self._ess.data = self._curves(picture, _relative_ess)
        self._error.data = self._curves(picture, lambda room: room.errors)

    def _curves(self, picture: Picture, values: Any) -> tuple[NDArray[np.float64], ...]:
        """The x-axis and a line for the toy and for the tracker, thinned out."""
        rooms = (picture.toy, picture.tracker)
        times = np.arange(1.0, max(picture.last, 1) + 1.0)
        lines = []
        for room in rooms:
            line = np.full(len(times), np.nan)
            known = values(room)
            first = room.trace.first - 1
            stop = min(first + len(known), len(times))
            line[first:stop] = known[: stop - first]
            lines.append(line)
        thin = slice(None, None, len(times) // _MOST_POINTS + 1)
        return (times[thin], *(line[thin] for line in lines))


def _relative_ess(room: Any) -> NDArray[np.float64]:
    sizes = np.array([len(record.posterior) for record in room.trace])
    return 100.0 * room.effective_sample_sizes / sizes


def _css(colour: Rgb) -> str:
    return "#{:02x}{:02x}{:02x}".format(*colour)


def _series(dark: bool) -> tuple[uplot.Series, ...]:
    palette = DARK if dark else LIGHT
    return (
        uplot.Series(label="t"),
        uplot.Series(label="toy", stroke=_css(palette.history), width=2, points={"show": False}),
        uplot.Series(label="video", stroke=_css(palette.posterior), width=2, points={"show": False}),
    )


def _axes(dark: bool) -> tuple[uplot.Axis, ...]:
    ink = _css((DARK if dark else LIGHT).ink)
    grid = {"stroke": _css((DARK if dark else LIGHT).faint), "width": 1}
    axis = uplot.Axis(stroke=ink, grid=grid, ticks={"show": False}, font="11px sans-serif")  # type: ignore[typeddict-item]
    return (axis, axis)
