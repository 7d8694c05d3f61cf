"""What a filter loses when it takes the system noise for too small or too large.

The second text (section 4): "When the estimated variance is too low or too high, the performance of CONDENSATION
degrades rapidly. Additional experiments (not shown here) have shown that the performance degradation of RB-SS-HS-SIR
is much less pronounced." These are such experiments.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pfviz.experiments.cells import Arm, by_run, grouped, is_film, mean, plain_arms, plain_mean, run_cells
from pfviz.experiments.experiment import Experiment, Job, Row, blocks
from pfviz.experiments.statistics import Estimate, mean_of, sign_of
from pfviz.experiments.summary import Cell, Curve, CurveFigure, CurvePanel, Summary, Table
from pfviz.experiments.tracking import EQUAL_TIME_PARTICLES
from pfviz.filters import FILTERS

FACTORS = (0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
PLACES = ("scene:twin:1", "scene:twin-fast:1", "scene:twin-near:2", "scene:twin-patches:1")
WORLDS = ("linear-gaussian", "plane")
_FILTERS = ("condensation", "basic-sir", "rb-ss-hs-sir", "auxiliary")
_TOY_PARTICLES, _TOY_SHARE = 30, 10
_BASE, _RIVAL = "CONDENSATION", "RB-SS-HS-SIR"


def jobs(
    seeds: int,
    places: Sequence[str] = PLACES,
    factors: Sequence[float] = FACTORS,
    filters: Sequence[str] = _FILTERS,
    share: float = 1.0,
) -> list[Job]:
    """The tracker with particle numbers of equal time, and ten times as many seeds on the toy worlds."""
    tracker = [Arm(FILTERS[name].title, name, max(2, round(share * EQUAL_TIME_PARTICLES[name]))) for name in filters]
    films = [arm.at(place, system=factor) for place in places for factor in factors for arm in tracker]
    toys = plain_arms(filters, _TOY_PARTICLES)
    worlds = [arm.at(world, system=factor) for world in WORLDS for factor in factors for arm in toys]
    return blocks(films, seeds, 4) + blocks(worlds, _TOY_SHARE * seeds, 20)


def measure_of(place: str) -> str:
    """What is compared: on films the distance, lost frames counting 50 px; on toy worlds the error."""
    return "capped" if is_film(place) else "error"


def where(place: str) -> str:
    """The group that a place is reported in: all films together, each toy world by itself."""
    return "tracker" if is_film(place) else place


def by_where(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Rows by ``where``."""
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(where(row["place"]), []).append(row)
    return groups


def degradation(rows: Sequence[Row], factor: float) -> dict[Any, float]:
    """By run, how much greater the error is with ``factor`` than with the right noise."""
    if not rows:
        return {}
    name = measure_of(rows[0]["place"])
    at, right = (by_run([row for row in rows if row["system"] == value], name) for value in (factor, 1.0))
    pairs = {key: (value, right.get(key)) for key, value in at.items()}
    return {key: a - b for key, (a, b) in pairs.items() if a is not None and b is not None}


def summarise(rows: Sequence[Row]) -> Summary:
    """Errors over the factor, their growth against the right noise, and whose growth is the greater."""
    cells, growth, sentences, panels = [], [], [], []
    for group, members in by_where(rows).items():
        by_label = {label: same for (label,), same in grouped(members, "label").items()}
        panels.append(CurvePanel(group, tuple(_curve(label, same) for label, same in by_label.items())))
        cells += [line for label, same in by_label.items() for line in _lines(group, label, same)]
        for factor in sorted({row["system"] for row in members} - {1.0}):
            line, sentence = _growth(group, factor, by_label)
            growth.append(line)
            sentences += sentence
    columns = ("place", "filter", "factor", "runs", "error", "low", "high", "share of frames lost", "ESS share")
    table = Table("noise-robustness", "Error by what the system noise is taken for", columns, tuple(cells))
    columns = ("place", "factor", f"{_BASE} grows by", "low", "high", f"{_RIVAL} grows by", "its low", "its high")
    columns += ("difference", "its low end", "its high end")
    grown = Table("degradation", "Growth of the error against the right noise", columns, tuple(growth))
    label = "deviation of the system noise, as a factor"
    title = "Error by what the system noise is taken for"
    figure = CurveFigure("noise-robustness", title, label, "error (px or units)", tuple(panels), True, True, False)
    return Summary((table, grown), (figure,) if panels else (), sentences)


def _lines(group: str, label: str, rows: Sequence[Row]) -> list[tuple[Cell, ...]]:
    lines = []
    for (factor,), same in grouped(sorted(rows, key=lambda row: row["system"]), "system").items():
        error = mean(same, measure_of(same[0]["place"]))
        rest = (plain_mean(same, "lost"), plain_mean(same, "ess_share"))
        lines.append((group, label, factor, len(same), error.value, error.low, error.high, *rest))
    return lines


def _curve(label: str, rows: Sequence[Row]) -> Curve:
    lines = _lines("", label, rows)
    x, y, low, high = (np.array([line[i] for line in lines], dtype=float) for i in (2, 4, 5, 6))
    return Curve(label, x, y, np.where(low > 0, low, np.nan), np.where(np.isfinite(high), high, np.nan))


def _growth(group: str, factor: float, by_label: dict[str, list[Row]]) -> tuple[tuple[Cell, ...], list[str]]:
    base, rival = (degradation(by_label.get(label, []), factor) for label in (_BASE, _RIVAL))
    both = [base[key] - rival[key] for key in base if key in rival]
    of_base, of_rival, gap = mean_of(base.values()), mean_of(rival.values()), mean_of(both)
    line = (group, factor, *_three(of_base), *_three(of_rival), *_three(gap))
    if gap.count < 2:
        return line, []
    verdict = _verdict(of_base, of_rival, gap)
    words = f"{group}, noise taken for {factor:g} times what it is: {_BASE} {of_base}, {_RIVAL} {of_rival}: {verdict}."
    return line, [words]


def _verdict(of_base: Estimate, of_rival: Estimate, gap: Estimate) -> str:
    """Whose error grows more; whose does not grow does not degrade, however much the other gains."""
    sign = sign_of(gap)
    if sign == "undecided":
        return "which degrades more cannot be told"
    worse, growth = (_BASE, of_base) if sign == "greater" else (_RIVAL, of_rival)
    if sign_of(growth) != "greater":
        return f"{worse} fares worse, but does not degrade"
    return f"{worse} degrades more, {'as the text says' if worse == _BASE else 'against the text'}"


def _three(estimate: Estimate) -> tuple[float, float, float]:
    return estimate.value, estimate.low, estimate.high


NOISE_ROBUSTNESS = Experiment(
    name="noise-robustness",
    title="Robustness against mis-stated system noise",
    question="How much does the error grow when the system noise is taken for too small or too large? For films the "
    "factor is against the tracker's own noise, which is not known to be the right one; for toy worlds against the "
    "noise that the data is drawn with. Growth is the error less that of the same run with factor 1.",
    seeds=16,
    jobs=jobs,
    run=run_cells,
    summarise=summarise,
)
