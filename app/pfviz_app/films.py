"""What the rooms show filters on: a toy world's recording, or a video. Both give one observation a step."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice
from pathlib import Path
from secrets import token_hex
from typing import Any, Protocol

import numpy as np

from pfviz.filters.registry import Filter
from pfviz.model import Model
from pfviz.particles import FloatArray, readonly
from pfviz.record import StepRecord
from pfviz.vision.limits import Limits, display_name
from pfviz.vision.presence import AT_START, NOT_YET_FOUND, Presence
from pfviz.vision.tracker import TrackerModel, TrackEstimate
from pfviz.vision.video import Box, EndOfVideo, Image, Truth, VideoSource, open_upload
from pfviz.worlds import World
from pfviz_app.exact_answer import ExactAnswer
from pfviz_app.start_box import USUAL, Assumptions

Point = tuple[float, float]
TOY_STEPS = 2000
_KEPT_ESTIMATES = 4


class Film(Protocol):
    """A sequence of observations and a model of it."""

    @property
    def length(self) -> int | None:
        """The last time there is, where known."""
        ...

    def sign(self, t: int) -> str:
        """What tells the observation at time ``t`` apart from those that follow the same ones; at 0 the whole film."""
        ...

    def model(self, system: float, observation: float, proposal: float) -> Model:
        """The model, believing in noises multiplied by these factors."""
        ...

    def observe(self, t: int, model: Any) -> Any:
        """The observation at time ``t``, from 1 on.

        Raises:
            EndOfVideo: when there are no more.
        """
        ...

    def exact(self) -> ExactAnswer | None:
        """The exact posterior before the first step, where there can be one."""
        ...

    def error(self, t: int, record: StepRecord) -> float:
        """The distance of the estimate from the truth; NaN where the truth is not known."""
        ...

    @property
    def presence(self) -> Presence | None:
        """Whether the object is there before the first step, where the film knows how to tell."""
        ...

    def looking(self, filter: Filter) -> Filter:
        """The filter, made to look for the object where it is lost."""
        ...

    def given(self, model: Any, presence: Presence | None) -> Any:
        """The model for the step that follows ``presence``."""
        ...

    def presence_after(self, model: Any, before: Presence | None, record: StepRecord) -> Presence | None:
        """Whether the object is there after a step."""
        ...


class ToyFilm:
    """A toy world's course, drawn as far as it is needed. The target can be taken and put elsewhere."""

    def __init__(self, world: World, seed: int, held: Mapping[int, FloatArray] | None = None) -> None:
        self.world, self._seed = world, seed
        self._held = {t: readonly(place) for t, place in (held or {}).items()}
        self._draw_anew()

    def _draw_anew(self) -> None:
        self._course = self.world.unfold(self._seed, self._held)
        self._drawn: list[tuple[FloatArray, FloatArray]] = []

    @property
    def length(self) -> int:
        return TOY_STEPS

    @property
    def held(self) -> Mapping[int, FloatArray]:
        """By time, where a visitor has put the target."""
        return self._held

    def hold(self, t: int, place: FloatArray) -> None:
        """Put the target at ``place (k,)`` at time ``t``; from there on it moves as it would have moved."""
        for later in [time for time in self._held if time > t]:
            del self._held[later]
        self._held[t] = readonly(place)
        if t <= len(self._drawn):
            self._draw_anew()

    def sign(self, t: int) -> str:
        return repr(self._held[t].tolist()) if t in self._held else "" if t else f"{self.world.name}, {self._seed}"

    def model(self, system: float, observation: float, proposal: float) -> Model:
        return self.world.model.with_noise(system, observation, proposal)

    def exact(self) -> ExactAnswer:
        model = self.world.model
        return ExactAnswer(model.dynamics.dimension, model.prior)

    def observe(self, t: int, model: Any) -> FloatArray:
        if t > self.length:
            raise EndOfVideo(f"the recording ends at {self.length}")
        return self._at(t)[1]

    def truth(self, t: int) -> FloatArray:
        """``(k,)``: the true innovation."""
        return self._at(t)[0]

    def _at(self, t: int) -> tuple[FloatArray, FloatArray]:
        self._drawn.extend(islice(self._course, max(t - len(self._drawn), 0)))
        return self._drawn[t - 1]

    def error(self, t: int, record: StepRecord) -> float:
        return float(np.linalg.norm(record.estimate - self.truth(t)))

    @property
    def presence(self) -> None:
        return None

    def looking(self, filter: Filter) -> Filter:
        return filter

    def given(self, model: Any, presence: Presence | None) -> Any:
        return model

    def presence_after(self, model: Any, before: Presence | None, record: StepRecord) -> None:
        return None


@dataclass(frozen=True, slots=True)
class Start:
    """What a visitor wants to follow.

    Attributes:
        frame: of the video, in which it was marked.
        outline: two opposite corners of a box about it, or at least three of its outline, in frame pixels.
    """

    frame: int
    outline: tuple[Point, ...]

    @property
    def box(self) -> Box | None:
        """Left, top, width and height of the box; None where it is an outline."""
        if len(self.outline) != 2:
            return None
        (x0, y0), (x1, y1) = self.outline
        return min(x0, x1), min(y0, y1), abs(x1 - x0), abs(y1 - y0)

    def learn(self, source: VideoSource, assumed: Assumptions = USUAL) -> TrackerModel:
        """The tracker's model of it.

        Raises:
            ValueError: if there is no such frame, or nothing to follow there.
        """
        image = source.read(self.frame)
        if self.box is None:
            return assumed.learn(image, source.frame_rate, polygon=self.outline)
        return assumed.learn(image, source.frame_rate, self.box)


@dataclass(frozen=True, slots=True)
class VideoSetup:
    """A video to track in: how to open it, what to track, from where.

    Attributes:
        open: opens the source anew; each visitor reads one of their own.
        model: learnt from the start frame.
        start_frame: the frame of time 1.
        title: of the video, for the screen.
        name: as ``open_source`` takes it; None for what a visitor has sent.
        start: what is followed; None where the video itself says what.
        assumed: of whatever is followed.
        limits: of what a video may cost, be it this one or one that a visitor sends.
        frame_rate: of images, where it was given.
        token: which no other setup has.
    """

    open: Callable[[], VideoSource]
    model: TrackerModel
    start_frame: int
    title: str
    name: str | None = None
    start: Start | None = None
    assumed: Assumptions = USUAL
    limits: Limits = field(default_factory=Limits)
    frame_rate: float | None = None
    token: str = field(default_factory=partial(token_hex, 8))

    @property
    def public_name(self) -> str:
        """What everybody may know it by: a scene's or a camera's name, or a file's without the folders."""
        return display_name(re.split(r"[/\\]", (self.name or self.title.removeprefix("Video: ")).rstrip("/\\"))[-1])


class VideoFilm:
    """A video and the tracker's model of the object in it."""

    def __init__(self, setup: VideoSetup, source: VideoSource | None = None) -> None:
        self.setup = self._given = setup
        self.source = source or setup.open()
        self.chosen_start: Start | None = None
        self._token = token_hex(8) if hasattr(self.source, "latest") else setup.token
        self._estimates: deque[tuple[StepRecord, TrackEstimate]] = deque(maxlen=_KEPT_ESTIMATES)
        self._temporary: Path | None = None

    @classmethod
    def uploaded(cls, path: Path, name: str, like: VideoSetup | None = None) -> VideoFilm:
        """A visitor's own video. What is in its middle is followed until they mark something.

        Args:
            path: of the file, which is deleted when the film is closed.
            name: as the visitor knows it.
            like: a video under whose limits and assumptions it is; what was learnt of that one's motion does not count.

        Raises:
            ValueError: if it cannot be read.
        """
        shown, limits = display_name(name), like.limits if like else Limits()
        assumed = replace(like.assumed, learnt_from=None, learnt=None) if like else USUAL
        try:
            source = open_upload(path, limits)
        except ValueError as error:
            path.unlink(missing_ok=True)
            raise ValueError(str(error).replace(display_name(path), shown)) from None
        try:
            width, height = source.size
            middle = Start(0, ((width / 3, height / 3), (2 * width / 3, 2 * height / 3)))
            model = middle.learn(source, assumed)
            setup = VideoSetup(lambda: source, model, 0, f"Video: {shown}", assumed=assumed, limits=limits)
        except Exception:
            source.close()
            path.unlink(missing_ok=True)
            raise
        film = cls(setup, source)
        film._temporary = path
        return film

    def following(self, start: Start | None) -> VideoFilm:
        """The same video from the frame in which something else is marked to be followed; with None what it began with.

        Raises:
            ValueError: if there is nothing to follow there.
        """
        film = copy(self)
        film._estimates = deque(maxlen=_KEPT_ESTIMATES)
        film.setup, film.chosen_start = self._given, start
        if start is not None:
            model = start.learn(self.source, self._given.assumed)
            film.setup = replace(self._given, model=model, start_frame=start.frame)
        return film

    @property
    def place(self) -> str | None:
        """The name of the film and of what is followed in it as the experiments know it; None where they do not."""
        name = self.setup.name
        known = name is not None and name.startswith("scene:") and not (self.chosen_start or self.setup.start)
        return name if known and self.setup.assumed == USUAL else None

    def _source_truth(self, t: int) -> Truth | None:
        """Where the source knows its object to be; it knows nothing of what a visitor has chosen."""
        return None if self.chosen_start else self.source.truth(self.frame_index(t))

    def frame_index(self, t: int) -> int:
        """The frame of the video that is seen at time ``t``."""
        return self.setup.start_frame + max(t, 1) - 1

    @property
    def length(self) -> int | None:
        count = self.source.frame_count
        return None if count is None else max(count - self.setup.start_frame, 0)

    def sign(self, t: int) -> str:
        return "" if t else f"{self._token}, {self.chosen_start}"

    def model(self, system: float, observation: float, proposal: float) -> TrackerModel:
        return self.setup.model.with_noise(system, observation, proposal)

    def image(self, t: int) -> Image:
        """The BGR frame at time ``t``."""
        return self.source.read(self.frame_index(t))

    def exact(self) -> None:
        return None

    def observe(self, t: int, model: TrackerModel) -> Any:
        return model.observe(self.image(t))

    def truth(self, t: int) -> TrackEstimate | None:
        """Where the object really is, where the source knows it."""
        learnt = self.setup.start.frame if self.setup.start else self.setup.start_frame
        truth, start = self._source_truth(t), self.source.truth(learnt)
        if truth is None or start is None:
            return None
        x, y, rotation, scale = truth
        state = np.array([x, y, rotation - start[2], np.log(scale / start[3])])
        return self.setup.model.estimate_of(state)

    def error(self, t: int, record: StepRecord) -> float:
        truth = self._source_truth(t)
        if truth is None:
            return float("nan")
        estimate = self.estimate(record)
        return float(np.hypot(estimate.x - truth[0], estimate.y - truth[1]))

    def estimate(self, record: StepRecord, model: TrackerModel | None = None) -> TrackEstimate:
        """Where the object is, by ``record``; of the latest records it is worked out only once.

        The model that made the record may know already, and is asked where it is given.
        """
        for known, estimate in self._estimates:
            if known is record:
                return estimate
        self._estimates.append((record, (model or self.setup.model).estimate(record)))
        return self._estimates[-1][1]

    @property
    def presence(self) -> Presence:
        return NOT_YET_FOUND if self.setup.model.searching else AT_START

    def looking(self, filter: Filter) -> Filter:
        return self.setup.assumed.looking(filter)

    def given(self, model: TrackerModel, presence: Presence | None) -> TrackerModel:
        return model if presence is None else model.given(presence)

    def presence_after(self, model: TrackerModel, before: Presence | None, record: StepRecord) -> Presence | None:
        return None if before is None else model.presence(before, record, self.estimate(record, model))

    def close(self) -> None:
        self.source.close()
        if self._temporary is not None:
            self._temporary.unlink(missing_ok=True)
