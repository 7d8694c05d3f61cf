"""How soon a filter finds an object that it has lost.

The first text (section 3): "if the object is lost the recovery is very slow [with CONDENSATION]. On the other hand
RB-subspace-SIR with History Sampling recovers fast from temporal mistakes."
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pfviz.experiments.cells import Arm, is_film, plain_arms, run_cells
from pfviz.experiments.experiment import Experiment, Job, Row, blocks
from pfviz.experiments.statistics import Estimate, mean_of, order_of, paired_difference, sign_of, wilson
from pfviz.experiments.summary import Cell, Curve, CurveFigure, CurvePanel, Summary, Table
from pfviz.experiments.tracking import EQUAL_TIME_PARTICLES
from pfviz.filters import FILTERS
from pfviz.worlds import get_world

PLACES = tuple(f"scene:{kind}:1" for kind in ("twin", "twin-small", "twin-fast", "twin-patches"))
_FILTERS = ("condensation", "basic-sir", "rb-ss-hs-sir", "icondensation", "auxiliary", "ls-hs-sir")
_FOUND_WITHIN, _FOUND_FOR = 15.0, 5
_TOY_PARTICLES, _TOY_STEPS, _TOY_SHARE = 100, 149, 10
_MARKS = (5, 15, 30, 75, 150)
_BASE, _RIVAL = "CONDENSATION", "RB-SS-HS-SIR"


def jobs(
    seeds: int, places: Sequence[str] = PLACES, filters: Sequence[str] = _FILTERS, share: float = 1.0
) -> list[Job]:
    """Films begun on the twin and in an empty place; the toy world whose target jumps, with ten times the seeds."""
    plain = [Arm(FILTERS[name].title, name, max(2, round(share * EQUAL_TIME_PARTICLES[name]))) for name in filters]
    restarts = (("restarting", True),)
    again = [
        Arm(f"{arm.label}, restarting", arm.filter, arm.particles, restarts)
        for arm in plain
        if arm.label in (_BASE, _RIVAL)
    ]
    films = [arm.at(place, start=start) for place in places for start in ("nowhere", "twin") for arm in plain + again]
    toys = [arm.at("recovery", steps=_TOY_STEPS) for arm in plain_arms(filters, _TOY_PARTICLES)]
    return blocks(films, seeds, 4) + blocks(toys, _TOY_SHARE * seeds, 20)


def waits(row: Row) -> list[tuple[float, bool]]:
    """How long the object was lost, and whether it was found then: once for a film, after every jump in the toy world.

    In a film it is found when the estimate has come within 15 px and stays there for 5 frames. In the toy world it is
    found when the estimate is within a tenth of the world's half-width.
    """
    if is_film(row["place"]):
        away = np.array([np.nan if value is None else value for value in row["distances"]])
        return [first_run(away < _FOUND_WITHIN, _FOUND_FOR)]
    world = get_world(row["place"])
    assert world.jumps is not None
    near = np.array(row["distances"]) < 0.1 * world.extent
    return [
        first_run(near[t - 1 : t - 1 + world.jumps.every], 1)
        for t in range(world.jumps.every, len(near), world.jumps.every)
    ]


def first_run(near: np.ndarray, length: int) -> tuple[float, bool]:
    """The index of the first ``length`` truths in a row, and True; else how many there are, and False."""
    counts = np.convolve(near.astype(int), np.ones(length, dtype=int), "valid") if len(near) >= length else np.zeros(0)
    found = np.flatnonzero(counts == length)
    return (float(found[0]), True) if len(found) else (float(len(near)), False)


def situation(row: Row) -> str:
    """What the object was lost to."""
    if not is_film(row["place"]):
        return "toy world: jump"
    return {"nowhere": "tracker: in an empty place", "twin": "tracker: on the twin"}[row["start"]]


def by_situation(rows: Sequence[Row]) -> dict[str, dict[str, list[Row]]]:
    """Rows by situation and filter."""
    groups: dict[str, dict[str, list[Row]]] = {}
    for row in rows:
        groups.setdefault(situation(row), {}).setdefault(row["label"], []).append(row)
    return groups


def mean_wait(rows: Sequence[Row]) -> Estimate:
    """The mean over runs of the frames until found, of those not found the whole film."""
    return mean_of(waits_by_run(rows).values())


def waits_by_run(rows: Sequence[Row]) -> dict[Any, float]:
    """The mean wait of each run by place and seed."""
    return {(row["place"], row["seed"]): float(np.mean([wait for wait, _ in waits(row)])) for row in rows}


def summarise(rows: Sequence[Row]) -> Summary:
    """How many have found the object again by when, and who is sooner."""
    cells, panels, sentences = [], [], []
    for name, by_label in by_situation(rows).items():
        panels.append(CurvePanel(name, tuple(_curve(label, members) for label, members in by_label.items())))
        cells += [_line(name, label, members) for label, members in by_label.items()]
        sentences += _sentences(name, by_label)
    columns = ("lost", "filter", "runs", "frames until found", "low", "high", "found at all", "found low", "found high")
    columns += tuple(f"found by frame {mark}" for mark in _MARKS)
    table = Table("recovery", "How soon a lost object is found again", columns, tuple(cells))
    title = "Share of runs that have not yet found the object"
    figure = CurveFigure("recovery", title, "frames since it was lost", "share still lost", tuple(panels))
    return Summary((table,), (figure,) if panels else (), sentences)


def _line(name: str, label: str, rows: Sequence[Row]) -> tuple[Cell, ...]:
    every = [wait for row in rows for wait in waits(row)]
    wait, found = mean_wait(rows), wilson(sum(done for _, done in every), len(every))
    longest = max(len(row["distances"]) for row in rows) if is_film(rows[0]["place"]) else 25
    marks = [
        sum(done and wait <= mark for wait, done in every) / len(every) if mark <= longest else None for mark in _MARKS
    ]
    return (name, label, len(rows), wait.value, wait.low, wait.high, found.value, found.low, found.high, *marks)


def _curve(label: str, rows: Sequence[Row]) -> Curve:
    every = [wait for row in rows for wait in waits(row)]
    last = int(max(wait for wait, _ in every))
    x = np.arange(last + 1, dtype=float)
    shares = [wilson(sum(not done or wait > t for wait, done in every), len(every)) for t in x]
    y, low, high = (np.array([getattr(share, part) for share in shares]) for part in ("value", "low", "high"))
    return Curve(label, x, y, low, high)


def _sentences(name: str, by_label: dict[str, list[Row]]) -> list[str]:
    sentences = []
    base, rival = (by_label.get(label, []) for label in (_BASE, _RIVAL))
    gap = paired_difference(waits_by_run(rival), waits_by_run(base))
    if gap.count > 1:
        verdict = {
            "less": f"{_RIVAL} finds it sooner, as the text says",
            "greater": f"{_BASE} finds it sooner, against the text",
            "undecided": "which is sooner cannot be told",
        }[sign_of(gap)]
        sentences.append(
            f"{name}: {_RIVAL} takes {mean_wait(rival)} frames, {_BASE} {mean_wait(base)}, those that never find it "
            f"counted with the whole film: {verdict}."
        )
    for label in (_BASE, _RIVAL):
        plain, again = by_label.get(label, []), by_label.get(f"{label}, restarting", [])
        if len(plain) > 1 and len(again) > 1 and order_of(mean_wait(again), mean_wait(plain)) == "less":
            sentences.append(f"{name}: with restarts {label} takes {mean_wait(again)} frames.")
    return sentences


RECOVERY = Experiment(
    name="recovery",
    title="Recovery of a lost object",
    question="A filter is told a wrong place at the start: an empty one, or the twin's. How many frames until it is "
    "within 15 px of the object, and stays for 5 frames? And in the toy world whose target jumps every 25 steps?",
    seeds=16,
    jobs=jobs,
    run=run_cells,
    summarise=summarise,
)
