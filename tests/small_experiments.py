"""Small versions of the experiments: quick, and enough to see that they measure what they say."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import pytest

from pfviz.experiments import (
    equal_time,
    noise_robustness,
    plain_arms,
    recovery,
    regime_map,
    tracking,
    unbiasedness,
)
from pfviz.experiments.comparison import comparison
from pfviz.experiments.experiment import Experiment, Job, Row
from pfviz.experiments.registry import get_experiment
from pfviz.experiments.runner import finished
from pfviz.experiments.summary import Summary

PLACE = "scene:twin-near:2"
ONE_CELL = {"system": (1.0,), "observation": (1.0,), "proposal": (1.0,)}
_CONTESTANTS = tracking.arms(["condensation", "basic-sir", "rb-ss-hs-sir"], 0.05)


def _few_of_the_bias(seeds: int) -> list[Job]:
    """All ratios; of the bias over noise and proposal, the two ends of the noise."""
    jobs = unbiasedness.jobs(seeds)
    return [job for job in jobs if job.settings.get("proposal", 1.0) == 1.0 and job.settings.get("system") != 1.0]


_JOBS = {
    "equal-time": partial(equal_time.jobs, filters=["condensation", "rb-ss-hs-sir"], counts=(100, 3200), frames=5),
    "tracking-error": partial(tracking.jobs, places=[PLACE], contestants=_CONTESTANTS),
    "loss-probability": partial(tracking.jobs, places=[PLACE], contestants=_CONTESTANTS),
    "regime-map": partial(
        regime_map.jobs,
        toy=ONE_CELL | {"system": (0.3, 1.0)},
        tracker=ONE_CELL,
        places=[PLACE],
        toy_counts=(25,),
        tracker_counts=(50,),
        ladders=((6400,), (200,)),
    ),
    "noise-robustness": partial(
        noise_robustness.jobs,
        places=[PLACE],
        factors=(0.25, 1.0),
        filters=["condensation", "rb-ss-hs-sir"],
        share=0.05,
    ),
    "recovery": partial(recovery.jobs, places=[PLACE], filters=["condensation", "rb-ss-hs-sir"], share=0.05),
    "unbiasedness": _few_of_the_bias,
}


def small(name: str) -> Experiment:
    """The experiment called ``name`` with a few of its settings."""
    return replace(get_experiment(name), jobs=_JOBS[name])


def toy_comparison(filters: tuple[str, ...] = ("condensation", "rb-hs-sir"), **settings) -> Experiment:
    """Two filters on a toy world: some hundredths of a second a job."""
    return comparison("linear-gaussian", plain_arms(filters, 20), steps=10, **settings)


def run_here(experiment: Experiment, seeds: int) -> tuple[list[Row], Summary]:
    """Its rows, in the order of its jobs, and what follows from them; in this process."""
    jobs = experiment.jobs(seeds)
    with ThreadPoolExecutor(1) as executor:
        rows = {job.key: rows for job, rows in finished(experiment, jobs, executor)}
    in_order = [row for job in jobs for row in rows[job.key]]
    return in_order, experiment.summarise(in_order)


def same_rows(some: Sequence[Row], others: Sequence[Row]) -> bool:
    """Whether rows are the same but for processor time and for the last digits.

    Sums over arrays may end in other digits in another process, by where the arrays lie in memory.
    """
    return len(some) == len(others) and all(
        row.keys() == other.keys()
        and all(_same(value, other[name]) for name, value in row.items() if name != "milliseconds")
        for row, other in zip(some, others, strict=True)
    )


def _same(value: object, other: object) -> bool:
    return value == (pytest.approx(other, rel=1e-9) if isinstance(other, (float, list)) else other)
