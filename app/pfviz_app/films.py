"""What the rooms show filters on: a toy world's recording, or a video. Both give one observation a step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from pfviz.exact import Gaussian, GridDensity, GridMarginal
from pfviz.model import Model
from pfviz.particles import FloatArray
from pfviz.record import StepRecord
from pfviz.vision.tracker import TrackerModel, TrackEstimate
from pfviz.vision.video import EndOfVideo, Image, VideoSource
from pfviz.worlds import Recording, World

TOY_STEPS = 2000
_KEPT_STATES = 32


class Film(Protocol):
    """A sequence of observations and a model of it."""

    @property
    def length(self) -> int | None:
        """The last time there is, where known."""
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

    def error(self, t: int, record: StepRecord) -> float:
        """The distance of the estimate from the truth; NaN where the truth is not known."""
        ...


class ToyFilm:
    """A toy world, drawn once for a seed."""

    def __init__(self, world: World, seed: int) -> None:
        self.world = world
        self.recording: Recording = world.record(seed, TOY_STEPS)
        self._marginals: dict[int, Gaussian | GridMarginal] = {}
        self._states: dict[int, Gaussian | GridDensity] = {}

    @property
    def length(self) -> int:
        return len(self.recording)

    def model(self, system: float, observation: float, proposal: float) -> Model:
        return self.world.model.with_noise(system, observation, proposal)

    def observe(self, t: int, model: Any) -> FloatArray:
        if t > self.length:
            raise EndOfVideo(f"the recording ends at {self.length}")
        self._exact_step(t, model)
        return self.recording.observations[t - 1]

    def exact(self, t: int) -> Gaussian | GridMarginal | None:
        """The exact posterior of the innovation at time ``t``, by the model that was believed in when it was run."""
        return self._marginals.get(t)

    def _exact_step(self, t: int, model: Any) -> None:
        """Follow the exact posterior to time ``t``, from the latest state before it that is still kept."""
        start = max((known for known in self._states if known < t), default=0)
        state = self._states.get(start, self.world.model.prior)
        for now in range(start + 1, t + 1):
            step = model.exact_step(state, self.recording.observations[now - 1])
            if step is None:
                self._marginals.pop(t, None)
                return
            state = self._states[now] = step.posterior
        self._marginals[t] = state.leading(1) if isinstance(state, GridDensity) else state.leading(self._dimension)
        for old in sorted(self._states)[:-_KEPT_STATES]:
            del self._states[old]

    @property
    def _dimension(self) -> int:
        return self.world.model.dynamics.dimension

    def truth(self, t: int) -> FloatArray:
        """``(k,)``: the true innovation."""
        return self.recording.truth[t - 1]

    def error(self, t: int, record: StepRecord) -> float:
        return float(np.linalg.norm(record.estimate - self.truth(t)))


@dataclass(frozen=True, slots=True)
class VideoSetup:
    """A video to track in: how to open it, what to track, from where.

    Attributes:
        open: opens the source anew; each visitor reads one of their own.
        model: learnt from the start frame.
        start_frame: the frame of time 1.
        title: of the video, for the screen.
    """

    open: Callable[[], VideoSource]
    model: TrackerModel
    start_frame: int
    title: str


class VideoFilm:
    """A video and the tracker's model of the object in it."""

    def __init__(self, setup: VideoSetup) -> None:
        self.setup = setup
        self.source = setup.open()

    @property
    def length(self) -> int | None:
        count = self.source.frame_count
        return None if count is None else max(count - self.setup.start_frame, 0)

    def model(self, system: float, observation: float, proposal: float) -> TrackerModel:
        return self.setup.model.with_noise(system, observation, proposal)

    def image(self, t: int) -> Image:
        """The BGR frame at time ``t``."""
        return self.source.read(self.setup.start_frame + t - 1)

    def observe(self, t: int, model: TrackerModel) -> Any:
        return model.observe(self.image(t))

    def truth(self, t: int) -> TrackEstimate | None:
        """Where the object really is, where the source knows it."""
        truth = self.source.truth(self.setup.start_frame + t - 1)
        start = self.source.truth(self.setup.start_frame)
        if truth is None or start is None:
            return None
        x, y, rotation, scale = truth
        state = np.array([x, y, rotation - start[2], np.log(scale / start[3])])
        return self.setup.model.estimate_of(state)

    def error(self, t: int, record: StepRecord) -> float:
        truth = self.source.truth(self.setup.start_frame + t - 1)
        if truth is None:
            return float("nan")
        estimate = self.setup.model.estimate(record)
        return float(np.hypot(estimate.x - truth[0], estimate.y - truth[1]))

    def close(self) -> None:
        self.source.close()
