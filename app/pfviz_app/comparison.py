"""Two filters in figures: what each of them makes of the same data, and the difference."""

from __future__ import annotations

import html
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from pfviz.exact import total_variation
from pfviz.filters import FILTERS
from pfviz_app.framing import framed
from pfviz_app.picture import Picture
from pfviz_app.room import Room
from pfviz_app.settings import ITSELF
from pfviz_app.stage.palette import DARK, LIGHT


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure of both filters.

    Attributes:
        label: what it is, with its unit.
        first: of the filter.
        second: of the one that it is compared with.
    """

    label: str
    first: float
    second: float


def figures(first: Room[Any], second: Room[Any], t: int, unit: str) -> tuple[Figure, ...]:
    """What is compared, at time ``t`` and on the average up to it; figures that neither has are left out."""
    pairs = zip(_figures(first, t, unit), _figures(second, t, unit), strict=True)
    found = [Figure(label, a, b) for (label, a), (_, b) in pairs]
    return tuple(figure for figure in found if np.isfinite([figure.first, figure.second]).any())


def _figures(room: Room[Any], t: int, unit: str) -> Iterator[tuple[str, float]]:
    record, outcome = room.trace[t], room.outcome(t)
    outcomes = [room.outcome(time) for time in range(room.trace.first, t + 1)]
    exact = room.exact.marginal(t) if room.exact else None
    yield f"error{unit}", outcome.error
    yield f"mean error{unit}", _mean([one.error for one in outcomes])
    yield "ESS", outcome.effective_sample_size
    yield "mean ESS", _mean([one.effective_sample_size for one in outcomes])
    yield "distance to exact", np.nan if exact is None else total_variation(record.posterior, exact)
    yield "log-evidence", outcome.log_evidence
    yield "ms a step", _mean([one.milliseconds for one in outcomes])
    yield "likelihoods", float(record.likelihood_evaluations)


def _mean(values: list[float]) -> float:
    known = [value for value in values if np.isfinite(value)]
    return float(np.mean(known)) if known else float("nan")


def comparison_html(picture: Picture) -> str:
    """The figures as a table, or how to get one."""
    rival = picture.rival
    if rival is None:
        return framed("Choose a filter under <b>Compare with</b>: it runs on the same data and random numbers.")
    if not picture.t or picture.of_rival() is None:
        return framed("Step or play: the figures of both filters come here.")
    palette = DARK if picture.settings.dark else LIGHT
    names = [FILTERS[lane.toy.outcome(picture.t).filter_name].title for lane in (picture.lane, rival)]
    colours = (palette.posterior, palette.rival)
    heads = "".join(
        f'<th style="text-align:right;color:rgb{colour}">{html.escape(name)}</th>'
        for name, colour in zip(names, colours, strict=True)
    )
    body = f"<tr><td></td>{heads}<th></th></tr>"
    for title, first, second, unit in (
        ("Toy", picture.toy, rival.toy, ""),
        ("Video", picture.tracker, rival.tracker, ", px"),
    ):
        body += f'<tr><td style="padding-top:6px;font-weight:600">{title}</td></tr>'
        body += "".join(_row(figure) for figure in figures(first, second, picture.t, unit))
    since = ""
    if picture.settings.rival == ITSELF:
        since = "<div>The second is what was kept: its settings stay as they were.</div>"
    return framed(f'{since}<table style="width:100%;border-collapse:collapse">{body}</table>')


def _row(figure: Figure) -> str:
    difference = figure.first - figure.second
    cells = (_number(figure.first), _number(figure.second), _number(difference, "+"))
    style = "text-align:right;font-variant-numeric:tabular-nums;padding-left:8px"
    tail = "".join(f'<td style="{style}{";opacity:.65" if i == 2 else ""}">{cell}</td>' for i, cell in enumerate(cells))
    return f"<tr><td>{html.escape(figure.label)}</td>{tail}</tr>"


def _number(value: float, sign: str = "") -> str:
    return "–" if not np.isfinite(value) else f"{value:{sign}.3g}" if abs(value) < 1000 else f"{value:{sign},.0f}"
