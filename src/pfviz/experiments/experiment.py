"""What an experiment is: units of work that can run anywhere, and what follows from their rows."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pfviz.experiments.summary import Summary

Settings = Mapping[str, Any]
Row = dict[str, Any]
"""One result: its settings, its seed and what was measured, all of them JSON values."""


class ExperimentError(ValueError):
    """An experiment that cannot run or go on; the message is one line."""


@dataclass(frozen=True, slots=True)
class Job:
    """A unit of work: it runs as a whole, on any machine, and its rows are stored as a whole.

    Attributes:
        settings: JSON values by name.
        seeds: of the runs with these settings.
    """

    settings: Settings
    seeds: tuple[int, ...]

    @property
    def key(self) -> str:
        """What its rows are stored under: a digest of settings and seeds."""
        return digest({"settings": dict(self.settings), "seeds": self.seeds})

    def describe(self) -> str:
        """Settings and seeds in one line."""
        words = [f"{name}={value}" for name, value in self.settings.items()]
        seeds = "-".join(str(seed) for seed in sorted({min(self.seeds), max(self.seeds)}))
        return ", ".join([*words, f"seeds {seeds}"])


@dataclass(frozen=True, slots=True)
class Experiment:
    """An experiment, as data.

    Attributes:
        name: as on the command line.
        title: as on the report.
        question: what it asks, in a sentence or two.
        seeds: how many it takes at full size.
        jobs: from a number of seeds, its units of work, in the order that they are wanted.
        run: the rows of a job; a function of a module, so that another process can find it.
        summarise: tables, figures and sentences from the rows; it must do with those of a part of the jobs.
        rows_of: what the rows are named after; experiments that share it can share a folder of results.
        version: to be raised when ``run`` measures something else under the same settings.
        one_at_a_time: whether jobs must not run beside each other, as where time is measured.
    """

    name: str
    title: str
    question: str
    seeds: int
    jobs: Callable[[int], Sequence[Job]]
    run: Callable[[Job], list[Row]]
    summarise: Callable[[Sequence[Row]], Summary]
    rows_of: str = ""
    version: int = 1
    one_at_a_time: bool = False

    @property
    def origin(self) -> str:
        """What its rows are named after."""
        return self.rows_of or self.name


def digest(value: Any) -> str:
    """A short digest of a JSON value, the same on every machine."""
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()[:20]


def blocks(settings: Iterable[Settings], seeds: int, size: int) -> list[Job]:
    """Jobs of ``size`` seeds each: all settings on the first seeds, then on the next, so that more seeds go on."""
    listed = list(settings)
    starts = range(0, seeds, size)
    return [Job(each, tuple(range(start, min(start + size, seeds)))) for start in starts for each in listed]


def run_seeds(measure: Callable[[Settings, int], Row], job: Job) -> list[Row]:
    """A row for each seed of ``job``: its settings, the seed and what ``measure`` returns."""
    return [{**job.settings, "seed": seed, **measure(job.settings, seed)} for seed in job.seeds]
