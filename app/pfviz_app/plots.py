"""The curves beside the picture: over time, and of the particles at the time on screen."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import viser
from viser import uplot

from pfviz.genealogy import ancestor_counts
from pfviz.particles import FloatArray, ParticleSet
from pfviz_app.lane import Lane
from pfviz_app.picture import Picture
from pfviz_app.room import Room
from pfviz_app.stage.palette import DARK, LIGHT, Palette, Rgb
from pfviz_app.turns import Allowance

_PERIOD = 0.5
_ALLOWANCE = Allowance(0.02)
"""For the charts of all visitors who are playing."""
_MOST_POINTS = 400
_CURVES = 5
_REACHES = (25, 50, 100, 200, 400, 1000, 2000)
_GENERATIONS = 30


@dataclass(frozen=True, slots=True)
class Line:
    """One curve of a chart.

    Attributes:
        label: of the curve.
        values: as many as there are places on the x-axis; NaN where there is none.
        colour: of the curve.
        scale: "y", or "px" for the axis on the right.
        dashed: whether it is.
    """

    label: str
    values: FloatArray
    colour: Rgb
    scale: str = "y"
    dashed: bool = False


Drawing = Callable[[Picture, Palette], tuple[FloatArray, list[Line]]]
"""The places on the x-axis, and the curves."""


class Plots:
    """Small charts in tabs, redrawn now and then while the film runs."""

    def __init__(self, client: viser.ClientHandle, panel: Any) -> None:
        self._shown: Any = None
        self._latest: list[ParticleSet] = []
        self._next = 0.0
        tabs: tuple[tuple[str, tuple[tuple[str, Drawing], ...]], ...] = (
            (
                "Time",
                (("effective sample size, % of N", _sizes), ("error: toy (left), video in px (right)", _errors)),
            ),
            ("Evidence", (("log-evidence, toy", _toy_evidence), ("log-evidence, video", _video_evidence))),
            (
                "Weights",
                (
                    ("part of the weight that the heaviest have, %", _lorenz),
                    ("different ancestors, by steps back", _ancestors),
                ),
            ),
        )
        self._charts: list[tuple[_Chart, Drawing]] = []
        for name, charts in tabs:
            with panel.add_tab(name):
                self._charts += [(_Chart(client, title), drawing) for title, drawing in charts]

    def draw(self, picture: Picture) -> None:
        """Show the rooms' records, unless nothing has changed or it is too soon."""
        now = time.monotonic()
        latest = [lane.toy.trace.particles for lane, _ in _lanes(picture)]
        state = (*map(id, latest), picture.last, picture.t, picture.playing, picture.settings)
        if state == self._shown or (picture.playing and not (now >= self._next and _ALLOWANCE.left)):
            return
        self._shown = state
        self._latest = latest  # so that no others get their ids
        palette = DARK if picture.settings.dark else LIGHT
        for chart, drawing in self._charts:
            chart.draw(*drawing(picture, palette), palette)
        self._next = now + _PERIOD
        _ALLOWANCE.spend(time.monotonic() - now)


class _Chart:
    """A chart that is sent anew when its curves change, and its axes and colours only when those do.

    It always has the same number of curves, the missing ones hidden: uPlot trips over a curve whose numbers have not
    come yet, and what is sent in one go may arrive in two.
    """

    def __init__(self, client: viser.ClientHandle, title: str) -> None:
        self._style: Any = None
        self._reach = (0.0, 1.0)
        self._plot = client.gui.add_uplot(
            tuple(np.array([0.0, 1.0]) for _ in range(_CURVES + 1)),
            (uplot.Series(label="x"), *(uplot.Series(label="", show=False) for _ in range(_CURVES))),
            title=title,
            scales={"x": {"time": False}},
            height=128,
            legend=uplot.Legend(show=False),
            padding=(8, 8, 0, 0),
        )

    def draw(self, places: FloatArray, lines: Sequence[Line], palette: Palette) -> None:
        lines = [line for line in lines if np.isfinite(line.values).any()] or lines[:1]
        reach = (float(places[0]), float(places[-1]))
        if reach != self._reach:
            self._reach = reach
            self._plot.scales = {"x": {"time": False, "range": reach}}
        style = (palette, [(line.label, line.colour, line.scale, line.dashed) for line in lines])
        missing = _CURVES - len(lines)
        if style != self._style:
            self._style = style
            hidden = [uplot.Series(label="", show=False) for _ in range(missing)]
            self._plot.series = (uplot.Series(label="x"), *(_stroke(line) for line in lines), *hidden)
            self._plot.axes = _axes(lines, palette)
        thin = slice(None, None, len(places) // _MOST_POINTS + 1)
        nothing = np.full(len(places[thin]), np.nan)
        self._plot.data = (places[thin], *(line.values[thin] for line in lines), *[nothing] * missing)


# What is drawn


def _lanes(picture: Picture) -> list[tuple[Lane, bool]]:
    return [(picture.lane, False)] + ([(picture.rival, True)] if picture.rival else [])


def _lines(
    picture: Picture, palette: Palette, values: Callable[[Room[Any]], FloatArray], right: str = "y"
) -> list[Line]:
    """A curve for each room of each lane; those of the videos by the axis ``right``."""
    lines = []
    for lane, rival in _lanes(picture):
        toy, video = (palette.rival, palette.rival) if rival else (palette.history, palette.posterior)
        lines.append(Line(f"toy {rival}", values(lane.toy), toy))
        lines.append(Line(f"video {rival}", values(lane.tracker), video, right, rival))
    return lines


def _over_time(
    picture: Picture, palette: Palette, values: Callable[[Room[Any]], FloatArray], right: str = "y"
) -> tuple[FloatArray, list[Line]]:
    times = np.arange(1.0, _reach(picture) + 1.0)
    return times, _lines(picture, palette, lambda room: _placed(room, values(room), len(times)), right)


def _sizes(picture: Picture, palette: Palette) -> tuple[FloatArray, list[Line]]:
    return _over_time(picture, palette, _relative_ess)


def _errors(picture: Picture, palette: Palette) -> tuple[FloatArray, list[Line]]:
    return _over_time(picture, palette, lambda room: room.errors, "px")


def _toy_evidence(picture: Picture, palette: Palette) -> tuple[FloatArray, list[Line]]:
    times = np.arange(1.0, _reach(picture) + 1.0)
    lines = [
        Line(f"toy {rival}", _placed(lane.toy, lane.toy.log_evidences, len(times)), _own(palette, rival))
        for lane, rival in _lanes(picture)
    ]
    exact = picture.toy.exact
    if exact is not None and picture.settings.exact:
        steps = np.array([exact.log_evidence(t) for t in range(1, picture.toy.trace.last + 1)])
        values = np.full(len(times), np.nan)
        values[: len(steps)] = np.cumsum(steps)[: len(times)]
        lines.append(Line("exact", values, palette.exact, dashed=True))
    return times, lines


def _video_evidence(picture: Picture, palette: Palette) -> tuple[FloatArray, list[Line]]:
    times = np.arange(1.0, _reach(picture) + 1.0)
    return times, [
        Line(f"video {rival}", _placed(lane.tracker, lane.tracker.log_evidences, len(times)), _own(palette, rival))
        for lane, rival in _lanes(picture)
    ]


def _lorenz(picture: Picture, palette: Palette) -> tuple[FloatArray, list[Line]]:
    """What part of the weight the heaviest particles have; the diagonal is where all weigh the same."""
    shares = np.linspace(0.0, 100.0, 51)
    return shares, [
        Line("even", shares, palette.faint),
        *_lines(picture, palette, lambda room: _weight_shares(room, picture.t, shares)),
    ]


def _weight_shares(room: Room[Any], t: int, shares: FloatArray) -> FloatArray:
    if not room.trace.first <= t <= room.trace.last:
        return np.full(len(shares), np.nan)
    record = room.trace[t]
    stage = record.stage("weight")
    weights = np.sort((stage.particles if stage else record.posterior).weights)[::-1]
    cumulative = np.concatenate([[0.0], np.cumsum(weights)])
    return 100.0 * np.interp(shares / 100.0 * len(weights), np.arange(len(cumulative)), cumulative)


def _ancestors(picture: Picture, palette: Palette) -> tuple[FloatArray, list[Line]]:
    def values(room: Room[Any]) -> FloatArray:
        line = np.full(_GENERATIONS + 1, np.nan)
        if room.trace.first <= picture.t <= room.trace.last and not picture.playing:
            counts = ancestor_counts(room.trace, picture.t, _GENERATIONS)
            line[: len(counts)] = counts
        return line

    return np.arange(0.0, _GENERATIONS + 1.0), _lines(picture, palette, values)


def _own(palette: Palette, rival: bool) -> Rgb:
    return palette.rival if rival else palette.posterior


def _relative_ess(room: Room[Any]) -> FloatArray:
    sizes = np.array([len(record.posterior) for record in room.trace])
    return 100.0 * room.effective_sample_sizes / sizes


def _reach(picture: Picture) -> int:
    """The last time of the x-axis: a round number beyond what is recorded, which changes rarely."""
    return next((reach for reach in _REACHES if picture.last <= reach), _REACHES[-1])


def _placed(room: Room[Any], known: FloatArray, length: int) -> FloatArray:
    """``(length,)``: the values known, at their times; NaN elsewhere."""
    line = np.full(length, np.nan)
    first = room.trace.first - 1
    stop = min(first + len(known), length)
    line[first:stop] = known[: stop - first]
    return line


# How uPlot wants it


def _axes(lines: Sequence[Line], palette: Palette) -> tuple[uplot.Axis, ...]:
    across = _axis(None, palette.ink, palette.faint, size=26)
    if not any(line.scale == "px" for line in lines):
        return across, _axis("y", palette.ink, palette.faint)
    right = _axis("px", palette.posterior, None)
    right["side"] = 1
    return across, _axis("y", palette.history, palette.faint), right


def _axis(scale: str | None, ink: Rgb, grid: Rgb | None, size: int = 34) -> uplot.Axis:
    """An axis whose numbers are in the colour of what they belong to."""
    lines = {"show": False} if grid is None else {"stroke": _css(grid), "width": 1}
    style = {"stroke": _css(ink), "grid": lines, "size": size, "font": "11px sans-serif", "ticks": {"show": False}}
    return cast(uplot.Axis, style if scale is None else style | {"scale": scale})


def _stroke(line: Line) -> uplot.Series:
    style = {"label": line.label, "stroke": _css(line.colour), "width": 2, "points": {"show": False}}
    return cast(uplot.Series, style | {"scale": line.scale} | ({"dash": (6, 4)} if line.dashed else {}))


def _css(colour: Rgb) -> str:
    return "#{:02x}{:02x}{:02x}".format(*colour)
