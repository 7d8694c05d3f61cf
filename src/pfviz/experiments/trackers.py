"""One run of a filter on video, and what is measured in it."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from time import thread_time
from typing import Any

import numpy as np

from pfviz.experiments.experiment import ExperimentError
from pfviz.experiments.measure import Measured, sharpness, spread, weighed_stage
from pfviz.filters import Filter, make_filter
from pfviz.particles import FloatArray
from pfviz.randomness import step_rng
from pfviz.record import StepRecord
from pfviz.vision.presence import AT_START
from pfviz.vision.restart import Restarting
from pfviz.vision.scenes import SIZE, make_scene
from pfviz.vision.tracker import TrackerModel, learn_tracker
from pfviz.vision.video import Box, frames, open_source

LOST = 50.0
"""Pixels from the object, in frames of 240 x 180, beyond which it is lost (section 3 of the sources)."""
_NEAR = 10.0
_FAR = 60.0


@dataclass(frozen=True)
class Film:
    """A video with what does not depend on the filter.

    Attributes:
        model: learnt from the first frame.
        observations: the features of every frame.
        truth: ``(T, 2)``, the object's centre in every frame; NaN where it is not known.
        twin: ``(2,)``, the centre of what looks like it, where there is such a thing.
        unit: pixels of the film for one of a frame of 240 x 180.
    """

    model: TrackerModel
    observations: tuple[Any, ...]
    truth: FloatArray
    twin: FloatArray | None
    unit: float


@lru_cache(maxsize=3)
def film(place: str, proposal: float = 1.0) -> Film:
    """The film called ``place``: ``scene:NAME``, ``scene:NAME:SEED`` or ``clip:NAME``; its proposal that much wider.

    Raises:
        ExperimentError: if there is no such clip.
    """
    kind, _, name = place.partition(":")
    return _clip(name, proposal) if kind == "clip" else _scene(name, proposal)


def _scene(name: str, proposal: float) -> Film:
    with make_scene(name) as scene:
        model = learn_tracker(scene.read(0), scene.box(0), frame_rate=scene.frame_rate).with_noise(proposal=proposal)
        observations = tuple(model.observe(scene.read(index)) for index in range(scene.frame_count))
        truth = np.array([scene.truth(index)[:2] for index in range(scene.frame_count)])
    return Film(model, observations, truth, scene.twin[:2], 1.0)


def _clip(name: str, proposal: float) -> Film:
    video, boxes, centres = _clip_truth(clips_folder() / name)
    with open_source(video) as source:
        start = _start_frame(boxes, source.size)
        image = source.read(start)
        model = learn_tracker(image, boxes[start], frame_rate=source.frame_rate).with_noise(proposal=proposal)
        seen = [(index, model.observe(image)) for index, image in frames(source, start)]
        unit = float(np.hypot(*source.size) / np.hypot(*SIZE))
    truth = np.array([centres.get(index, (np.nan, np.nan)) for index, _ in seen])
    return Film(model, tuple(observation for _, observation in seen), truth, None, unit)


def clips_folder() -> Path:
    """The folder of clips that ``PFVIZ_CLIPS`` names: ``NAME/video.mp4`` beside ``NAME/truth.csv``.

    Raises:
        ExperimentError: if it is not set or is not a folder.
    """
    named = os.environ.get("PFVIZ_CLIPS", "")
    if not named:
        raise ExperimentError("PFVIZ_CLIPS is not set: expected a folder of clips, NAME/video.mp4 and NAME/truth.csv")
    if not Path(named).is_dir():
        raise ExperimentError(f"PFVIZ_CLIPS: there is no folder '{named}'")
    return Path(named)


def clip_names() -> list[str]:
    """The clips that there are.

    Raises:
        ExperimentError: if there are none.
    """
    folder = clips_folder()
    names = sorted(path.parent.name for path in folder.glob("*/truth.csv") if (path.parent / "video.mp4").is_file())
    if not names:
        raise ExperimentError(f"PFVIZ_CLIPS: no clips in '{folder}', expected NAME/video.mp4 and NAME/truth.csv")
    return names


def _clip_truth(folder: Path) -> tuple[Path, dict[int, Box], dict[int, tuple[float, float]]]:
    """Video, boxes and centres by frame; of several objects, those of the first ``id``."""
    boxes: dict[int, Box] = {}
    centres: dict[int, tuple[float, float]] = {}
    try:
        with (folder / "truth.csv").open(newline="", encoding="utf-8") as stream:
            rows = list(csv.DictReader(stream))
        for row in rows:
            if row.get("id") == rows[0].get("id"):
                index = int(row["frame"])
                boxes[index] = (float(row["x"]), float(row["y"]), float(row["w"]), float(row["h"]))
                centres[index] = (float(row["cx"]), float(row["cy"]))
    except (OSError, KeyError, ValueError) as error:
        raise ExperimentError(f"{folder / 'truth.csv'}: expected frame,x,y,w,h,cx,cy: {error}") from None
    return folder / "video.mp4", boxes, centres


def _start_frame(boxes: dict[int, Box], size: tuple[int, int]) -> int:
    """The first frame in which the object is wholly in the picture and not much smaller than it usually is."""
    usual = float(np.median([w * h for _, _, w, h in boxes.values()]))
    for index, (x, y, w, h) in sorted(boxes.items()):
        if min(x, y) > 1.0 and x + w < size[0] - 1.0 and y + h < size[1] - 1.0 and w * h > 0.7 * usual:
            return index
    return min(boxes)


def believed(
    model: TrackerModel, system: float, observation: float, variance: float | None, unit: float = 1.0
) -> TrackerModel:
    """``model`` with its noises multiplied; or with this ``variance`` of the noise of x and y, in square units.

    A unit is that many pixels. The noises of rotation and scale go along, so that the shape of the noise stays the
    same.
    """
    if variance is not None:
        system = float(unit * np.sqrt(variance / model.dynamics.noise_covariance[0, 0]))
    return model.with_noise(system=system, observation=observation)


def tracker_run(
    place: str,
    filter_name: str,
    particles: int,
    seed: int,
    system: float = 1.0,
    observation: float = 1.0,
    proposal: float = 1.0,
    variance: float | None = None,
    start: str = "object",
    restarting: bool = False,
) -> Measured:
    """A filter over a film; distances in pixels of a frame of 240 x 180.

    Args:
        place: as ``film`` takes it.
        filter_name: as on the command line.
        particles: how many.
        seed: of the filter.
        system: what the system noise is multiplied by.
        observation: the observation noise.
        proposal: the proposal's width.
        variance: of the noise of x and y in square pixels of a frame of 240 x 180, instead of ``system``.
        start: what the filter takes for the object at the start: the ``object``, its ``twin``, or ``nowhere``, a
            random place away from both.
        restarting: whether the tracker's judgement of being lost is used, and the filter then looks for the object.

    Returns:
        ``distances`` of the estimate from the object by frame (None where the truth is not known); ``error``, their
        mean over the frames in which it is not lost (None if there are none); ``capped``, the mean of distances taken
        for 50 where they are more; ``lost``, the share of frames in which it is lost; ``lost_at_end``; ``twin``, the
        share of the lost frames in which the estimate is on the twin; and what may explain them: ``ess_share``,
        ``proposal_spread`` and ``posterior_spread`` in pixels, ``near_share`` of the proposed particles within 10
        pixels of the object, ``sharpness`` of the likelihood; ``milliseconds`` of processor time a frame, without
        the features.
    """
    made = film(place, proposal)
    model = believed(made.model, system, observation, variance, made.unit)
    model = replace(model, start=_start(made, start, seed))
    run = _restarting_steps if restarting else _steps
    estimates, explained, milliseconds = _followed(
        made, model, run(made, model, make_filter(filter_name, particles), seed)
    )
    return {**distances(estimates, made), **_explanations(explained), "milliseconds": milliseconds}


def _followed(made: Film, model: TrackerModel, records: Iterator[StepRecord]) -> tuple[FloatArray, FloatArray, float]:
    """Estimates ``(T, 2)``, what explains them ``(T, 5)``, and the processor time of a step in milliseconds.

    Records are looked at as they come and forgotten: together they would take hundreds of megabytes.
    """
    estimates, explained, spent = [], [], 0.0
    began = thread_time()
    for record, centre in zip(records, made.truth, strict=True):
        spent += thread_time() - began
        estimate = model.estimate(record)
        estimates.append((estimate.x, estimate.y))
        explained.append(_explanation(record, centre, made.unit))
        began = thread_time()
    return np.array(estimates), np.array(explained), 1000.0 * spent / len(estimates)


def _steps(made: Film, model: TrackerModel, filter_: Filter, seed: int) -> Iterator[StepRecord]:
    particles = filter_.initial(step_rng(seed, 0), model)
    for t, observation in enumerate(made.observations, start=1):
        record = filter_.step(step_rng(seed, t), model, particles, observation)
        particles = record.posterior
        yield record


def _restarting_steps(made: Film, model: TrackerModel, filter_: Filter, seed: int) -> Iterator[StepRecord]:
    restarting, presence = Restarting(filter_), AT_START
    particles = restarting.initial(step_rng(seed, 0), model)
    for t, observation in enumerate(made.observations, start=1):
        record = restarting.step(step_rng(seed, t), model.given(presence), particles, observation)
        presence = model.presence(presence, record)
        particles = record.posterior
        yield record


def _start(made: Film, start: str, seed: int) -> FloatArray:
    """``(4,)``: the state that the filter begins at; see ``tracker_run``."""
    state = np.array(made.model.start)
    if start == "object":
        return state
    if made.twin is None:
        raise ExperimentError(f"start={start}: only scenes have a twin")
    if start == "twin":
        state[:2] = made.twin
        return state
    size = np.array(made.model.size)
    places = np.random.default_rng([seed, 5]).uniform(0.1 * size, 0.9 * size, (500, 2))
    away = np.minimum(*(np.linalg.norm(places - taken, axis=1) for taken in (state[:2], made.twin)))
    state[:2] = places[np.argmax(away > _FAR)]
    return state


def distances(estimates: FloatArray, made: Film) -> Measured:
    """How far ``estimates (T, 2)`` are from the truth, and what follows from it; see ``tracker_run``."""
    away = np.linalg.norm(estimates - made.truth, axis=1) / made.unit
    known = np.isfinite(away)
    lost = known & (away > LOST)
    followed = known & ~lost
    measured: Measured = {
        "distances": [round(float(value), 2) if np.isfinite(value) else None for value in away],
        "error": float(away[followed].mean()) if followed.any() else None,
        "capped": float(np.minimum(away[known], LOST).mean()),
        "lost": float(lost.sum() / known.sum()),
        "lost_at_end": int(lost[known][-1]),
    }
    if made.twin is not None:
        on_twin = np.linalg.norm(estimates - made.twin, axis=1) < 0.5 * LOST
        measured["twin"] = float(on_twin[lost].mean()) if lost.any() else None
    return measured


_EXPLAINING = ("ess_share", "proposal_spread", "posterior_spread", "near_share", "sharpness")


def _explanation(record: StepRecord, centre: FloatArray, unit: float) -> tuple[float, ...]:
    """The values of ``_EXPLAINING`` in one frame; NaN for what there is not."""
    stage = weighed_stage(record)
    proposed = (record.stages[-1] if stage is None else stage).particles.innovation[:, :2]
    posterior, weights = record.posterior.innovation[:, :2], record.posterior.weights
    variance = weights @ np.square(posterior - weights @ posterior)
    near = np.sum(np.square(proposed - centre), axis=1) < (_NEAR * unit) ** 2
    sharp = sharpness(record)
    return (
        record.effective_sample_size / len(record.posterior),
        spread(proposed) / unit,
        float(np.sqrt(variance.sum())) / unit,
        float(near.mean()) if np.isfinite(centre).all() else np.nan,
        np.nan if sharp is None else sharp,
    )


def _explanations(explained: FloatArray) -> Measured:
    """Means over the frames of what may explain an error."""
    columns = [column[np.isfinite(column)] for column in explained.T]
    means = [float(column.mean()) if len(column) else None for column in columns]
    return dict(zip(_EXPLAINING, means, strict=True))
