"""Table 5 of the sources: how many particles each filter affords in the same time."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from time import thread_time

import numpy as np

from pfviz.experiments.cells import grouped, mean
from pfviz.experiments.experiment import Experiment, Job, Row, Settings, blocks
from pfviz.experiments.statistics import Estimate, mean_of
from pfviz.experiments.summary import Curve, CurveFigure, CurvePanel, Summary, Table
from pfviz.experiments.trackers import believed
from pfviz.filters import FILTERS, make_filter
from pfviz.randomness import step_rng
from pfviz.vision.scenes import make_scene
from pfviz.vision.tracker import TrackerModel, learn_tracker
from pfviz.vision.video import Image

REFERENCE, REFERENCE_PARTICLES = "condensation", 2000
SOURCES = {"condensation": 2000, "basic-sir": 3000, "rb-ss-hs-sir": 400}
"""Table 5: particle numbers of equal running time on a Pentium IV at 1.4 GHz."""
_COUNTS = (50, 100, 200, 400, 800, 1200, 1600, 2400, 3200, 4800)
_ENOUGH = 1.5
_UNDISTURBED = 0.1


def jobs(seeds: int, filters: Sequence[str] = (), counts: Sequence[int] = _COUNTS, frames: int = 25) -> list[Job]:
    chosen = list(filters) or [name for name in FILTERS if name != "rb-hs-sir"]
    settings = {"place": "scene:twin", "filters": chosen, "counts": list(counts), "frames": frames, "variance": 5.0}
    return blocks([settings], seeds, 1)


def run_round(job: Job) -> list[Row]:
    """One round over all filters: the processor time of a frame at each number of particles that is not far too many.

    A frame is its features, the filter's step and the estimate. The order of the filters differs from round to round.
    """
    settings, seed = job.settings, job.seeds[0]
    budget = _frame_time(REFERENCE, REFERENCE_PARTICLES, settings, seed)
    base = {"place": settings["place"], "seed": seed}
    rows = [{**base, "filter": REFERENCE, "particles": REFERENCE_PARTICLES, "milliseconds": budget, "budget": True}]
    for name in np.random.default_rng(seed).permutation(settings["filters"]):
        for count in settings["counts"]:
            taken = _frame_time(str(name), count, settings, seed)
            rows.append({**base, "filter": str(name), "particles": count, "milliseconds": taken, "budget": False})
            if taken > _ENOUGH * budget:
                break
    again = _frame_time(REFERENCE, REFERENCE_PARTICLES, settings, seed)
    rows[0]["milliseconds"] = min(budget, again)
    return rows


def _frame_time(name: str, count: int, settings: Settings, seed: int) -> float:
    """Milliseconds of processor time of a frame that nothing disturbed: a low quantile over the first frames.

    Other processes take away caches and shared cores, which slows a frame down, and never makes it quicker.
    """
    images, model = _material(settings["place"], settings["frames"], settings["variance"])
    filter_ = make_filter(name, count)
    particles, times = filter_.initial(step_rng(seed, 0), model), []
    for t, image in enumerate(images, start=1):
        began = thread_time()
        record = filter_.step(step_rng(seed, t), model, particles, model.observe(image))
        model.estimate(record)
        times.append(1000.0 * (thread_time() - began))
        particles = record.posterior
    return float(np.quantile(times[2:], _UNDISTURBED))


@lru_cache(maxsize=1)
def _material(place: str, frames: int, variance: float) -> tuple[list[Image], TrackerModel]:
    with make_scene(place.removeprefix("scene:")) as scene:
        images = [scene.read(index) for index in range(frames)]
        return images, believed(learn_tracker(images[0], scene.box(0)), 1.0, 1.0, variance)


def affordable(counts: Sequence[int], milliseconds: Sequence[float], budget: float) -> float | None:
    """How many particles take ``budget``: interpolated in the logarithms; None outside what was measured."""
    order = np.argsort(counts)
    log_n, log_t = np.log(np.asarray(counts)[order]), np.log(np.asarray(milliseconds)[order])
    rising = np.maximum.accumulate(log_t)
    if len(rising) < 2 or not rising[0] <= np.log(budget) <= rising[-1]:
        return None
    return float(np.exp(np.interp(np.log(budget), rising, log_n)))


def _affordable_of(rows: Sequence[Row], name: str) -> Estimate:
    found = []
    for of_round in grouped(rows, "seed").values():
        budget = [row["milliseconds"] for row in of_round if row["budget"]]
        ladder = [row for row in of_round if row["filter"] == name and not row["budget"]]
        if budget and ladder:
            counts, times = [row["particles"] for row in ladder], [row["milliseconds"] for row in ladder]
            found.append(affordable(counts, times, budget[0]))
    return mean_of(found)


def summarise(rows: Sequence[Row]) -> Summary:
    """Table 5 with what the sources had, the times behind it, and what it says."""
    names = list(dict.fromkeys(row["filter"] for row in rows if not row["budget"]))
    equal = {name: _affordable_of(rows, name) for name in sorted(names, key=list(FILTERS).index)}
    budget = mean([row for row in rows if row["budget"]], "milliseconds")
    table = Table(
        "equal-time",
        "Particles of equal running time",
        ("filter", "particles", "low", "high", "rounds", "in the sources"),
        tuple(
            (FILTERS[name].title, e.value, e.low, e.high, e.count, SOURCES.get(name))
            for name, e in equal.items()
            if e.count
        ),
    )
    return Summary((table, _times(rows)), (_figure(rows, budget),), _sentences(equal, budget))


def _times(rows: Sequence[Row]) -> Table:
    cells = []
    for (name, count), members in grouped([row for row in rows if not row["budget"]], "filter", "particles").items():
        taken = mean(members, "milliseconds")
        cells.append((FILTERS[name].title, count, taken.value, taken.low, taken.high))
    columns = ("filter", "particles", "milliseconds a frame", "low", "high")
    return Table("equal-time-milliseconds", "Processor time of a frame", columns, tuple(sorted(cells)), shown=False)


def _figure(rows: Sequence[Row], budget: Estimate) -> CurveFigure:
    curves = []
    for (name,), members in grouped([row for row in rows if not row["budget"]], "filter").items():
        ladder = [(count, mean(same, "milliseconds").value) for (count,), same in grouped(members, "particles").items()]
        x, y = np.array(sorted(ladder), dtype=float).T
        curves.append(Curve(FILTERS[name].title, x, y))
    label = f"CONDENSATION with 2000: {budget.value:.2g} ms"
    curves.append(Curve(label, np.array(_COUNTS, dtype=float), np.full(len(_COUNTS), budget.value)))
    panel = CurvePanel("", tuple(curves))
    title = "Processor time of a frame"
    return CurveFigure("equal-time", title, "particles", "milliseconds a frame", (panel,), log_x=True, log_y=True)


def _sentences(equal: dict[str, Estimate], budget: Estimate) -> list[str]:
    sentences = [
        f"CONDENSATION with {REFERENCE_PARTICLES} particles takes {budget} ms of processor time a frame of the scene "
        f"`twin`, features and estimate included ({budget.count} rounds)."
    ]
    for name, estimate in equal.items():
        if estimate.count and name != REFERENCE:
            before = f"; the sources had {SOURCES[name]}" if name in SOURCES else ""
            sentences.append(f"{FILTERS[name].title} affords {estimate} particles in that time{before}.")
    return sentences


EQUAL_TIME = Experiment(
    name="equal-time",
    title="Particles of equal running time",
    question="How many particles does each filter afford in the time that CONDENSATION takes for 2000 "
    "(Table 5 of the sources)?",
    seeds=20,
    jobs=jobs,
    run=run_round,
    summarise=summarise,
    version=3,
    one_at_a_time=True,
)
