"""The experiments with few places, settings and particles: half a minute or so instead of half an hour.

They ask the same questions and report in the same way; what they cannot tell, they say.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

from pfviz.experiments import equal_time, noise_robustness, real_clips, recovery, regime_map, tracking, unbiasedness
from pfviz.experiments.experiment import Experiment, Job
from pfviz.experiments.registry import get_experiment
from pfviz.experiments.trackers import clip_names

_PLACES = ("scene:twin:1", "scene:twin-near:2")
_DUEL = ("condensation", "rb-ss-hs-sir")
_SOURCES = ("condensation", "basic-sir", "rb-ss-hs-sir")
_SHARE = 0.25
_CELLS = {"system": (0.3, 1.0), "observation": (0.3, 1.0), "proposal": (1.0,)}


def _first_clip(seeds: int) -> list[Job]:
    return real_clips.jobs(seeds, _DUEL, _SHARE, clip_names()[:1])


_JOBS: dict[str, Callable[[int], Sequence[Job]]] = {
    "equal-time": partial(equal_time.jobs, filters=_SOURCES, counts=(100, 400, 1600, 4800), frames=10),
    "tracking-error": partial(tracking.jobs, places=_PLACES, contestants=tracking.arms(_SOURCES, _SHARE), block=1),
    "loss-probability": partial(tracking.jobs, places=_PLACES, contestants=tracking.arms(_SOURCES, _SHARE), block=1),
    "regime-map": partial(
        regime_map.jobs,
        toy=_CELLS,
        tracker={"system": (0.5, 2.0), "observation": (1.0,), "proposal": (1.0,)},
        places=_PLACES[1:],
        toy_counts=(25, 100),
        tracker_counts=(100,),
    ),
    "noise-robustness": partial(
        noise_robustness.jobs, places=_PLACES[1:], factors=(0.25, 1.0, 4.0), filters=_DUEL, share=_SHARE
    ),
    "recovery": partial(recovery.jobs, places=_PLACES[:1], filters=_DUEL, share=_SHARE),
    "unbiasedness": unbiasedness.jobs,
    "real-clips": _first_clip,
}


def get_small_experiment(name: str) -> Experiment:
    """The experiment called ``name``, in small.

    Raises:
        UnknownName: if there is none; the message suggests the nearest.
    """
    experiment = get_experiment(name)
    return replace(experiment, title=f"{experiment.title}, in small", seeds=5, jobs=_JOBS[experiment.name])
