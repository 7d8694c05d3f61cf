"""Where history sampling pays: over system noise, sharpness of the likelihood, width of the proposal, and N.

Small system noise makes arbitrary associations impossible, and a sharp likelihood makes predicted particles miss it:
the first hurts Basic-SIR, the second CONDENSATION.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pfviz.experiments.cells import Arm, difference, grouped, is_film, mean, plain_arms, plain_mean, run_cells
from pfviz.experiments.experiment import Experiment, Job, Row, blocks
from pfviz.experiments.statistics import Estimate, sign_of
from pfviz.experiments.summary import Cell, HeatFigure, HeatPanel, Summary, Table
from pfviz.filters import FILTERS

WORLD = "linear-gaussian"
PLACES = ("scene:twin:1", "scene:twin-fast:1", "scene:twin-near:2")
_TOY = {"system": (0.1, 0.3, 1.0, 3.0), "observation": (0.1, 0.3, 1.0, 3.0), "proposal": (0.5, 1.0, 3.0)}
_TRACKER = {"system": (0.5, 1.0, 2.0, 4.0), "observation": (0.5, 1.0, 2.0), "proposal": (1.0,)}
_TOY_COUNTS, _TRACKER_COUNTS = (25, 100, 400), (100, 400, 1200)
_TOY_LADDER, _TRACKER_LADDER = (1600, 6400), (2400,)
_TOY_STEPS, _TOY_SHARE = 40, 5
FILTERS_SHOWN = ("condensation", "basic-sir", "rb-ss-hs-sir")
_DUEL = _BASE, _RIVAL = "condensation", "rb-ss-hs-sir"


def jobs(
    seeds: int,
    toy: Mapping[str, Sequence[float]] = _TOY,
    tracker: Mapping[str, Sequence[float]] = _TRACKER,
    places: Sequence[str] = PLACES,
    toy_counts: Sequence[int] = _TOY_COUNTS,
    tracker_counts: Sequence[int] = _TRACKER_COUNTS,
    ladders: tuple[Sequence[int], Sequence[int]] = (_TOY_LADDER, _TRACKER_LADDER),
) -> list[Job]:
    """The grid on the linear-Gaussian world, whose data are drawn with the noise of the cell, and on the films.

    CONDENSATION is run with the more particles of ``ladders`` as well, to hold the others against it in equal time.
    """
    of_toy, of_tracker = _arms(toy_counts, ladders[0]), _arms(tracker_counts, ladders[1])
    worlds = [arm.at(WORLD, steps=_TOY_STEPS, matched=True, **cell) for cell in _grid(toy) for arm in of_toy]
    films = [arm.at(place, **cell) for place in places for cell in _grid(tracker) for arm in of_tracker]
    return blocks(worlds, _TOY_SHARE * seeds, 10) + blocks(films, seeds, 2)


def _arms(counts: Sequence[int], ladder: Sequence[int]) -> list[Arm]:
    arms = [arm for count in counts for arm in plain_arms(FILTERS_SHOWN, count)]
    return arms + [arm for count in ladder for arm in plain_arms([_BASE], count)]


def _grid(axes: Mapping[str, Sequence[float]]) -> list[dict[str, float]]:
    return [
        {"system": system, "observation": observation, "proposal": proposal}
        for proposal in axes["proposal"]
        for system in axes["system"]
        for observation in axes["observation"]
    ]


@dataclass(frozen=True, slots=True)
class Region:
    """One group of places and what is compared there.

    Attributes:
        name: of the group, in file names too.
        measure: the error that is compared.
        unit: of it.
        rows: all of the group.
    """

    name: str
    measure: str
    unit: str
    rows: list[Row]


def regions(rows: Sequence[Row]) -> list[Region]:
    """The toy world, by the distance from the exact mean; the films, by the distance from the object."""
    films, toys = [row for row in rows if is_film(row["place"])], [row for row in rows if not is_film(row["place"])]
    found = [
        Region("toy", "excess", "deviations of the exact posterior", toys),
        Region("tracker", "capped", "px", films),
    ]
    return [region for region in found if region.rows]


def summarise(rows: Sequence[Row]) -> Summary:
    """Heat maps of ESS, error and loss; where history sampling pays in particles and in time."""
    tables, figures, sentences = [], [], []
    for region in regions(rows):
        payoff, in_time = payoff_table(region), in_time_table(region)
        tables += [_cells_table(region), payoff, in_time]
        figures += _heat_figures(region)
        sentences += _sentences(region, payoff, in_time)
    return Summary(tables, figures, sentences)


def _cells_table(region: Region) -> Table:
    names = ("filter", "particles", "proposal", "system", "observation")
    cells = []
    for key, members in grouped(region.rows, *names).items():
        error = mean(members, region.measure)
        rest = (plain_mean(members, name) for name in ("ess_share", "lost"))
        cells.append((FILTERS[key[0]].title, *key[1:], len(members), error.value, error.low, error.high, *rest))
    columns = (*names, "runs", f"error ({region.unit})", "low", "high", "ESS share")
    columns += ("share of frames lost",)
    title = f"All cells: {region.name}"
    return Table(f"regime-map-{region.name}", title, columns, tuple(cells), shown=False)


def payoff_table(region: Region) -> Table:
    """By cell and N: CONDENSATION's error less RB-SS-HS-SIR's with as many particles."""
    cells: list[tuple[Cell, ...]] = []
    for key, base, rival in _duels(region):
        for (count,), members in rival.items():
            gap = difference(base.get((count,), []), members, region.measure)
            cells.append((*key, count, gap.count, gap.value, gap.low, gap.high, _better(gap)))
    columns = ("proposal", "system", "observation", "particles", "runs", "CONDENSATION less RB-SS-HS-SIR")
    title = f"Where history sampling pays, particle for particle: {region.name}"
    return Table(f"payoff-{region.name}", title, (*columns, "low", "high", "better"), tuple(cells))


def in_time_table(region: Region) -> Table:
    """The same against CONDENSATION with that number of particles, of those measured, whose time is the nearest."""
    cells: list[tuple[Cell, ...]] = []
    for key, base, rival in _duels(region):
        for (count,), members in rival.items():
            time = mean(members, "milliseconds").value
            times = {other: mean(rows, "milliseconds").value for (other,), rows in base.items()}
            if not times or not min(times.values()) < 2.0 * time or not max(times.values()) > 0.5 * time:
                continue
            other = min(times, key=lambda other: abs(np.log(times[other] / time)))
            gap = difference(base[(other,)], members, region.measure)
            numbers = (count, time, other, times[other], gap.count, gap.value, gap.low, gap.high)
            cells.append((*key, *numbers, _better(gap)))
    columns = (
        "proposal",
        "system",
        "observation",
        "particles",
        "milliseconds",
        "CONDENSATION with",
        "its milliseconds",
    )
    columns += ("runs", "CONDENSATION less RB-SS-HS-SIR", "low", "high", "better")
    title = f"Where history sampling pays, in as much time: {region.name}"
    return Table(f"payoff-in-time-{region.name}", title, columns, tuple(cells))


Duel = tuple[tuple[float, ...], dict[tuple[int], list[Row]], dict[tuple[int], list[Row]]]


def _duels(region: Region) -> Iterator[Duel]:
    """Every cell with the rows of the two filters by their number of particles."""
    for key, members in grouped(region.rows, "proposal", "system", "observation").items():
        base, rival = (grouped([row for row in members if row["filter"] == name], "particles") for name in _DUEL)
        yield key, base, rival


def _better(gap: Estimate) -> str:
    return {"greater": "RB-SS-HS-SIR", "less": "CONDENSATION", "undecided": "not to be told"}[sign_of(gap)]


def _heat_figures(region: Region) -> list[HeatFigure]:
    shown = [("ess", "ess_share", "ESS over N", False), ("error", region.measure, f"error ({region.unit})", True)]
    shown += [("loss", "lost", "share of frames lost", False)] if region.name == "tracker" else []
    proposal = 1.0 if any(row["proposal"] == 1.0 for row in region.rows) else region.rows[0]["proposal"]
    rows = [row for row in region.rows if row["proposal"] == proposal]
    better = {
        (row[3], row[1], row[2]): row[-1] == "RB-SS-HS-SIR"
        for row in payoff_table(Region(region.name, region.measure, region.unit, rows)).rows
    }
    compared, figures = {row["particles"] for row in rows if row["filter"] == _RIVAL}, []
    for name, measure, label, log in shown:
        panels = [
            _heat_panel(key, members, measure, better if measure == region.measure else {})
            for key, members in sorted(grouped(rows, "particles", "filter").items())
            if key[0] in compared
        ]
        title = f"{region.name}: {label}" + ("; outlined: history sampling better" if measure == region.measure else "")
        axes = ("system noise, as a factor", "observation noise, as a factor", label)
        figures.append(HeatFigure(f"regime-map-{region.name}-{name}", title, *axes, tuple(panels), 3, log))
    return figures


def _heat_panel(
    key: tuple[int, str], rows: Sequence[Row], measure: str, better: Mapping[tuple[Cell, ...], bool]
) -> HeatPanel:
    count, name = key
    system, observation = (tuple(sorted({row[axis] for row in rows})) for axis in ("system", "observation"))
    cells = {place: mean(same, measure).value for place, same in grouped(rows, "system", "observation").items()}
    values = np.array([[cells.get((s, o), np.nan) for s in system] for o in observation])
    marked = np.array([[better.get((count, s, o), False) for s in system] for o in observation])
    title = f"{FILTERS[name].title}, N = {count}"
    return HeatPanel(title, system, observation, values, marked if name == _RIVAL else None)


def _sentences(region: Region, payoff: Table, in_time: Table) -> list[str]:
    """Where the line runs, N by N: in particles, then in time."""
    sentences = []
    for table, words in ((payoff, "with as many particles"), (in_time, "in as much time")):
        for count in dict.fromkeys(table.column("particles")):
            rows = [row for row in table.rows if row[3] == count]
            won, lost = ([row for row in rows if row[-1] == who] for who in ("RB-SS-HS-SIR", "CONDENSATION"))
            sentences.append(
                f"{region.name}, {words}, N = {count} for RB-SS-HS-SIR: it has the smaller error in {len(won)} of "
                f"{len(rows)} cells{_where(won)}, CONDENSATION in {len(lost)}{_where(lost)}; the others cannot be told."
            )
    return sentences


def _where(rows: Sequence[tuple[Cell, ...]]) -> str:
    """The typical setting of some cells."""
    if not rows:
        return ""
    system, observation = (np.exp(np.mean(np.log([float(row[i] or 1.0) for row in rows]))) for i in (1, 2))
    return f" (geometric means there: system noise × {system:.2g}, observation noise × {observation:.2g})"


REGIME_MAP = Experiment(
    name="regime-map",
    title="Where history sampling pays",
    question="Over system noise, sharpness of the likelihood, width of the proposal and number of particles: how large "
    "are ESS, error and loss, and from where on is RB-SS-HS-SIR better than CONDENSATION, with as many particles and "
    "in as much time? On the linear-Gaussian world the error is that against the exact posterior mean, and the data "
    "are drawn with the noises of the cell; on the films lost frames count 50 px.",
    seeds=8,
    jobs=jobs,
    run=run_cells,
    summarise=summarise,
)
