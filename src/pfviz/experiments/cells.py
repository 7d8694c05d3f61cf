"""What most experiments are made of: runs of filters at places with settings, and rows grouped again."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pfviz.experiments.experiment import Job, Row, Settings, run_seeds
from pfviz.experiments.measure import Measured, toy_run
from pfviz.experiments.statistics import Estimate, mean_of, paired_difference
from pfviz.experiments.summary import Table
from pfviz.experiments.trackers import tracker_run
from pfviz.filters import FILTERS

_NAMING = ("place", "label", "filter")


@dataclass(frozen=True, slots=True)
class Arm:
    """A filter with a number of particles and settings of its own, as one contestant.

    Attributes:
        label: what it is called.
        filter: its name, as on the command line.
        particles: how many.
        settings: others of ``toy_run`` or ``tracker_run``.
    """

    label: str
    filter: str
    particles: int
    settings: tuple[tuple[str, Any], ...] = ()

    def at(self, place: str, **settings: Any) -> Settings:
        """The settings of its runs at ``place``."""
        named = {"place": place, "label": self.label, "filter": self.filter, "particles": self.particles}
        return {**named, **dict(self.settings), **settings}


def plain_arms(filters: Iterable[str], particles: int) -> tuple[Arm, ...]:
    """The ``filters`` by their names, with as many ``particles`` each."""
    return tuple(Arm(FILTERS[name].title, name, particles) for name in filters)


def run_cells(job: Job) -> list[Row]:
    """A row for each seed: a run at ``place``, a toy world or a film, with the other settings."""
    return run_seeds(_run, job)


def _run(settings: Settings, seed: int) -> Measured:
    place, rest = settings["place"], {name: value for name, value in settings.items() if name not in _NAMING}
    run = tracker_run if is_film(place) else toy_run
    return run(place, settings["filter"], seed=seed, **rest)


def is_film(place: str) -> bool:
    """Whether a place is a scene or a clip, not a toy world."""
    return place.startswith(("scene:", "clip:"))


def grouped(rows: Iterable[Row], *names: str) -> dict[tuple[Any, ...], list[Row]]:
    """Rows by their values of ``names``, in the order in which these first occur."""
    groups: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(row.get(name) for name in names), []).append(row)
    return groups


def values(rows: Iterable[Row], name: str) -> list[float | None]:
    """What was measured under ``name``, row by row."""
    return [row.get(name) for row in rows]


def mean(rows: Iterable[Row], name: str) -> Estimate:
    """Its mean, with an interval."""
    return mean_of(values(rows, name))


def plain_mean(rows: Iterable[Row], name: str) -> float | None:
    """Its mean alone, None where it was never measured."""
    value = mean(rows, name).value
    return value if np.isfinite(value) else None


def time_table(rows: Iterable[Row], *names: str) -> Table:
    """Processor time of a step by ``names``: the one table that is another each time."""
    cells = []
    for key, members in grouped(rows, *names).items():
        taken = mean(members, "milliseconds")
        cells.append((*key, taken.count, taken.value, taken.low, taken.high))
    columns = (*names, "runs", "milliseconds a step", "low", "high")
    return Table("processor-time", "Processor time of a step, on the machine that it ran on", columns, tuple(cells))


def by_run(rows: Iterable[Row], name: str, *keys: str) -> dict[Hashable, float | None]:
    """What was measured under ``name`` by the run's ``keys``, seed and place by default: to pair runs by."""
    return {tuple(row.get(key) for key in keys or ("place", "seed")): row.get(name) for row in rows}


def difference(first: Sequence[Row], second: Sequence[Row], name: str, *keys: str) -> Estimate:
    """The mean difference of ``name`` between two arms over the runs of both, paired by place and seed."""
    return paired_difference(by_run(first, name, *keys), by_run(second, name, *keys))
