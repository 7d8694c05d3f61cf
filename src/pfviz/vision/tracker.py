"""The tracker's model: how an outline moves, what is proposed from a frame, and how a frame is explained."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pfviz.dynamics.autoregressive import Autoregression
from pfviz.names import find
from pfviz.particles import FloatArray, ParticleSet, readonly
from pfviz.record import StepRecord
from pfviz.vision.blob import BlobDetector, GridProposal
from pfviz.vision.colour import ColourRatio
from pfviz.vision.features import (
    WORKING_WIDTH,
    FeatureExtractor,
    FrameFeatures,
    learn_edge_threshold,
    working_image,
    working_scale,
)
from pfviz.vision.likelihoods import ColourLikelihood, ContourLikelihood, HistogramLikelihood, MotionLikelihood
from pfviz.vision.motion import DEFAULT_DYNAMICS, MotionScale, joined_motion, make_motion
from pfviz.vision.options import TrackerOptions
from pfviz.vision.presence import NOT_YET_FOUND, Presence, PresenceRule, weighed_posterior
from pfviz.vision.segmentation import box_error, segment
from pfviz.vision.shapes import (
    DEFAULT_POINTS,
    DEFAULT_SHAPE,
    SHAPES,
    Contour,
    contour_from_box,
    contour_from_mask,
    contour_from_polygon,
    transforms,
)
from pfviz.vision.video import DEFAULT_FRAME_RATE, Box, Image

DEFAULT_MODEL = "contour+colour"
MODELS = {
    "contour": "the nearest edge along each normal of the outline (CONDENSATION)",
    "colour": "the object's colours inside the outline, the background's just outside",
    "histogram": "colour histograms of the object's two halves, as they were learnt (Pérez et al. 2002)",
    "contour+colour": "the product of the two, taken as independent",
    "contour+histogram": "the product of the two, taken as independent",
    "contour+motion": "edges, and the look that the object had a frame ago (Odobez' implicit motion)",
    "contour+colour+motion": "edges, colours, and the look that the object had a frame ago",
}
_ANYWHERE = np.array([0.3, 0.1, 0.05, 0.05])
_BACKGROUND_PLACES = 256
_WINDOW, _WINDOW_SHARE = 0.5, 0.5
_MOST_SQUARES = 1 << 16


@dataclass(frozen=True, slots=True)
class TrackEstimate:
    """Where the object is, in frame pixels.

    Attributes:
        x: of its centre.
        y: of its centre.
        rotation: radians since the start.
        scale: relative to the start.
        box: ``(x, y, width, height)`` of its outline.
        stretch: the rest of an affine map; see ``pfviz.vision.shapes``.
    """

    x: float
    y: float
    rotation: float
    scale: float
    box: Box
    stretch: tuple[float, float] | None = None

    @property
    def state(self) -> FloatArray:
        """``(4,)``, or ``(6,)`` in the affine shape space: as a state of the tracker."""
        return np.array([self.x, self.y, self.rotation, np.log(self.scale), *(self.stretch or ())])


@dataclass(frozen=True)
class TrackerModel:
    """A contour tracker: the experiment of the sources (section 3), for any object.

    The state is ``(x, y, rotation, log_scale)``, of second order; other shape spaces have fewer or more components
    (see ``pfviz.vision.shapes``), other dynamics another order. The detector proposes x and y in all of them.

    Attributes:
        name: of the measurement, a key of ``MODELS``.
        contour: the object's outline, in frame pixels.
        size: width and height of the frame.
        start: ``(k,)``, the state in which the outline was learnt.
        dynamics: of the state.
        prior_deviation: ``(2, k)``, standard deviations of the first state and of its velocity.
        extractor: of what is measured.
        contour_likelihood: of the edges, None where ``name`` does not use it.
        colour_likelihood: of the colours, None where ``name`` does not use it. What is used is multiplied.
        presence_rule: when the object counts as lost, and as found.
        histogram_likelihood: of the colour histograms, None where ``name`` does not use it.
        motion_likelihood: of the look a frame ago, None where ``name`` does not use it.
        expected: where the object is thought to be, in pixels, from the frames before; None where that is not known.
        patch_before: ``(M,)``, the look a frame ago; None where the object was not tracked then, or nothing needs it.
        searching: whether the object is lost: the prior is then that of an object that may be anywhere in the frame,
            and a ``Restarting`` filter looks for it.
    """

    name: str
    contour: Contour
    size: tuple[int, int]
    start: FloatArray
    dynamics: Autoregression
    prior_deviation: FloatArray
    extractor: FeatureExtractor
    contour_likelihood: ContourLikelihood | None
    colour_likelihood: ColourLikelihood | None
    presence_rule: PresenceRule
    histogram_likelihood: HistogramLikelihood | None = None
    motion_likelihood: MotionLikelihood | None = None
    expected: tuple[float, float] | None = None
    patch_before: FloatArray | None = None
    searching: bool = False

    def observe(self, image: Image) -> FrameFeatures:
        """The features of a BGR ``image`` of the model's size.

        Raises:
            ValueError: if the image has another size.
        """
        if image.shape[1::-1] != self.size:
            raise ValueError(f"expected a frame of {self.size}, got {image.shape[1::-1]} (width, height)")
        return self.extractor(image)

    def log_likelihood(self, innovation: FloatArray, observation: FrameFeatures) -> FloatArray:
        """``(N,)``: log p(y | x1) for ``innovation (N, k)``, but for a constant of the frame."""
        parts = self.log_likelihood_parts(innovation, observation).values()
        return sum(parts, start=np.zeros(len(innovation)))

    def log_likelihood_parts(self, innovation: FloatArray, observation: FrameFeatures) -> dict[str, FloatArray]:
        """What each measurement says, by name: the terms of ``log_likelihood``, each ``(N,)``."""
        matrices = transforms(innovation, self.extractor.working_scale)
        parts = {}
        if self.contour_likelihood is not None:
            parts["contour"] = self.contour_likelihood.log_likelihood(matrices, observation.edge_map)
        if self.colour_likelihood is not None:
            parts["colour"] = self.colour_likelihood.log_likelihood(matrices, observation.ratio)
        if self.histogram_likelihood is not None and observation.bins is not None:
            parts["histogram"] = self.histogram_likelihood.log_likelihood(matrices, observation.bins)
        motion, before, grey = self.motion_likelihood, self.patch_before, observation.grey
        if motion is not None and before is not None and grey is not None:
            parts["motion"] = motion.log_likelihood(matrices, grey, before)
        return parts

    def proposal(self, observation: FrameFeatures) -> GridProposal:
        """The blob detector's answer for the frame: a density of x and y.

        While the object is tracked, half of it is the same within a window about where the object is expected, so that
        the particles are not shared out evenly among all that look alike. The window depends on frames before this one,
        not on this one, and the density is known exactly, so the weights are right as before.
        """
        if self.expected is None:
            return observation.proposal
        spread = _WINDOW * self.contour.size + 2.0 * float(np.sqrt(self.dynamics.noise_covariance[0, 0]))
        return observation.proposal.gated(np.array(self.expected), spread, _WINDOW_SHARE)

    def sample_prior(self, rng: np.random.Generator, count: int) -> FloatArray:
        """``(count, p, k)``: states of the frame before the start, which move on to about ``start``.

        While the model is searching they lie anywhere in the frame, turned and sized a little differently.
        """
        position, velocity = rng.standard_normal((2, count, len(self.start))) * self.prior_deviation[:, None]
        previous = self.start + position - velocity
        if self.searching:
            previous[:, :2] = rng.random((count, 2)) * self.size
            wider = _ANYWHERE[: len(self.start) - 2] / self.prior_deviation[0, 2:]
            previous[:, 2:] = self.start[2:] + position[:, 2:] * wider
        ages = np.arange(self.dynamics.order)[:, None]
        return previous[:, None] - ages * velocity[:, None]

    def given(self, presence: Presence) -> TrackerModel:
        """The model for the step that follows ``presence``: searching unless the object is tracked."""
        searching, expected, patch = not presence.tracked, presence.expected, presence.patch
        if searching == self.searching and expected == self.expected and patch is self.patch_before:
            return self
        return replace(self, searching=searching, expected=expected, patch_before=patch)

    def with_noise(self, system: float = 1.0, observation: float = 1.0, proposal: float = 1.0) -> TrackerModel:
        """The same model with the standard deviations of its noises multiplied by these factors."""
        names = ("contour_likelihood", "colour_likelihood", "histogram_likelihood", "motion_likelihood")
        likelihoods = {name: getattr(self, name) for name in names}
        detector = self.extractor.detector.widened(proposal)
        return replace(
            self,
            dynamics=self.dynamics.with_noise(system),
            extractor=replace(self.extractor, detector=detector),
            presence_rule=self.presence_rule.scaled(observation**-2.0),
            **{name: used and used.with_noise(observation) for name, used in likelihoods.items()},
        )

    def estimate(self, record: StepRecord) -> TrackEstimate:
        """The mean of the posterior's dominant mode, before any restart; see ``dominant_mean``.

        It is worked out once for the step that was asked about last.
        """
        particles = weighed_posterior(record)
        known, estimate = self._last_estimate
        if known is not particles:
            estimate = self.estimate_of(dominant_mean(particles, self.contour.size))
            self.__dict__["_last_estimate"] = particles, estimate
        return estimate

    @cached_property
    def _last_estimate(self) -> tuple[ParticleSet | None, Any]:
        return None, None

    @cached_property
    def _last_score(self) -> tuple[FrameFeatures | None, TrackEstimate | None, float]:
        return None, None, float("nan")

    def score(self, record: StepRecord, estimate: TrackEstimate | None = None) -> float:
        """The log-likelihood of the estimate in its frame; NaN where nothing was observed.

        Implicit motion is left out: it compares with the frame before, whatever was tracked there.
        """
        if record.condition == "missing":
            return float("nan")
        estimate = estimate or self.estimate(record)
        seen, scored, score = self._last_score
        if seen is not record.observation or scored is not estimate:
            still = self if self.patch_before is None else replace(self, patch_before=None)
            parts = still.log_likelihood_parts(estimate.state[None], record.observation)
            score = float(sum(part[0] for part in parts.values()))
            self.__dict__["_last_score"] = record.observation, estimate, score
        return score

    def presence(self, before: Presence, record: StepRecord, estimate: TrackEstimate | None = None) -> Presence:
        """Whether the object is tracked or lost after the step of ``record``, from what was believed before it.

        A run begins with ``AT_START``, or with ``NOT_YET_FOUND`` where the object may be absent.

        Args:
            before: the presence after the step before.
            record: the step.
            estimate: that of the step, where it is known already.
        """
        estimate = estimate or self.estimate(record)
        after = self.presence_rule.after(before, self.score(record, estimate))
        if not after.tracked:
            return after
        after = replace(after, expected=self._expected(record, estimate))
        grey = getattr(record.observation, "grey", None)
        if self.motion_likelihood is None or grey is None:
            return after
        placing = transforms(estimate.state[None], self.extractor.working_scale)[0]
        return replace(after, patch=self.motion_likelihood.patch(placing, grey))

    def _expected(self, record: StepRecord, estimate: TrackEstimate) -> tuple[float, float]:
        """Where the dynamics lead from the estimate: the mean of where they lead from the particles about it."""
        particles = weighed_posterior(record)
        away = np.hypot(particles.innovation[:, 0] - estimate.x, particles.innovation[:, 1] - estimate.y)
        weights = np.where(away <= self.contour.size, particles.weights, 0.0)
        if not weights.sum() > 0.0:
            return estimate.x, estimate.y
        x, y = (weights @ self.dynamics.predict(particles.states)[:, :2] / weights.sum()).tolist()
        return x, y

    def estimate_of(self, state: FloatArray) -> TrackEstimate:
        """A ``state (k,)`` in the terms that are reported."""
        x, y, rotation, log_scale, *stretch = (float(value) for value in (*state, 0.0, 0.0)[: max(4, len(state))])
        box = self.contour.bounding_box(state)
        return TrackEstimate(
            x, y, rotation, float(np.exp(log_scale)), box, (stretch[0], stretch[1]) if stretch else None
        )


def dominant_mean(particles: ParticleSet, reach: float) -> FloatArray:
    """``(k,)``: the weighted mean of the particles about the heaviest place.

    When two objects look alike the posterior has two modes, and its mean lies between them, where nothing is.
    So the particles within ``reach`` pixels of the heaviest place are found by mean shift, from the heaviest
    square of a grid, and only they are averaged. With one mode this is the mean.
    """
    innovation, weights = particles.innovation, particles.weights
    positions = np.ascontiguousarray(innovation[:, :2])
    x, y = np.ascontiguousarray(positions.T)
    centre = _heaviest_place(positions, weights, reach)
    near = np.ones(len(weights), dtype=bool)
    for _ in range(10):
        now = (x - centre[0]) ** 2 + (y - centre[1]) ** 2 <= reach**2
        if not now.any() or (now == near).all():
            break
        near = now
        centre = _mean(positions, weights, near)
    return _mean(innovation, weights, near)


def _heaviest_place(positions: FloatArray, weights: FloatArray, reach: float) -> FloatArray:
    """``(2,)``: the mean of the particles in the heaviest square of side ``reach``."""
    columns, rows = np.floor((positions - positions.min(axis=0)) / reach).astype(int).T
    labels = columns * (rows.max() + 1) + rows
    if labels.max() > _MOST_SQUARES:
        _, labels = np.unique(labels, return_inverse=True)
    return _mean(positions, weights, labels == np.argmax(np.bincount(labels, weights)))


def _mean(values: FloatArray, weights: FloatArray, chosen: NDArray[np.bool_]) -> FloatArray:
    """``(k,)``: the weighted mean of the ``chosen (N,)`` of ``values (N, k)``; plain where none of them weighs."""
    own = weights[chosen] + 1e-300
    return (values[chosen] * own[:, None]).sum(axis=0) / own.sum()


def learn_tracker(
    image: Image,
    box: Box | None = None,
    polygon: ArrayLike | None = None,
    frame_rate: float = DEFAULT_FRAME_RATE,
    model: str = DEFAULT_MODEL,
    options: TrackerOptions | None = None,
    shape: str = DEFAULT_SHAPE,
    dynamics: str | Autoregression = DEFAULT_DYNAMICS,
) -> TrackerModel:
    """A tracker for the object in ``box`` (or inside ``polygon``) in one BGR ``image``.

    Args:
        image: the frame to learn from.
        box: ``(x, y, width, height)`` about the object. Its outline is found by segmentation in the box, or,
            where that is unclear, taken to be a rounded box.
        polygon: ``(n, 2)``, the outline, clicked; used instead of the segmentation.
        frame_rate: frames per second: at a lower rate more happens between two frames.
        model: what is measured, a key of ``MODELS``.
        options: what else is assumed.
        shape: how the outline can change, a key of ``SHAPES``.
        dynamics: how it moves, a key of ``DYNAMICS``; or any autoregression, of the whole state or of its first
            components (x and y, say): the others are then hand-held.

    Raises:
        ValueError: if neither box nor polygon is given, the box does not fit the frame, or the dynamics have more
            components than the shape space.
        UnknownName: if there is no such model, shape space or dynamics.
    """
    find(MODELS, model, "model")
    options = options or TrackerOptions()
    size = (image.shape[1], image.shape[0])
    if box is not None and (problem := box_error(box, size)):
        raise ValueError(problem)
    contour, centre = learn_contour(image, box, polygon, options.normals)
    start = readonly(np.concatenate([centre, np.zeros(find(SHAPES, shape, "shape") - 2)]))
    motion = _motion(dynamics, MotionScale(size, contour.size, frame_rate, len(start)), start, options)
    extractor = learn_features(image, contour, start, options.working_width)
    used = set(model.split("+"))
    extractor = replace(extractor, histograms="histogram" in used, motion="motion" in used)
    tracker = TrackerModel(
        name=model,
        contour=contour,
        size=size,
        start=start,
        dynamics=motion,
        prior_deviation=_prior_deviation(motion, contour.size),
        extractor=extractor,
        presence_rule=PresenceRule(0.0, -1.0),
        **_learn_likelihoods(used, contour, extractor, extractor(image), start, options),
    )
    return replace(tracker, presence_rule=learn_presence(tracker, image))


def _motion(
    dynamics: str | Autoregression, scale: MotionScale, start: FloatArray, options: TrackerOptions
) -> Autoregression:
    if isinstance(dynamics, str):
        return make_motion(dynamics, scale, start, options)
    return joined_motion(dynamics, make_motion(DEFAULT_DYNAMICS, scale, start, options))


def _learn_likelihoods(
    used: set[str],
    contour: Contour,
    extractor: FeatureExtractor,
    features: FrameFeatures,
    start: FloatArray,
    options: TrackerOptions,
) -> dict[str, Any]:
    """The likelihoods that are ``used``, by the model's attribute; None for the others."""
    edges = ContourLikelihood(
        points=contour.points,
        normals=contour.normals,
        search=extractor.reach,
        sigma=extractor.reach / 1.5,
        temper=options.independent_normals / contour.count,
    )
    histogram = None
    if features.bins is not None:
        placing = transforms(start[None], extractor.working_scale)[0]
        histogram = HistogramLikelihood.learn(contour, features.bins, placing, options.histogram_strength)
    return {
        "contour_likelihood": edges if "contour" in used else None,
        "colour_likelihood": ColourLikelihood.around(contour, options.independent_pixels) if "colour" in used else None,
        "histogram_likelihood": histogram,
        "motion_likelihood": MotionLikelihood.around(contour, options.motion_strength) if "motion" in used else None,
    }


def learn_presence(model: TrackerModel, image: Image) -> PresenceRule:
    """The levels of score that tell the object in ``image``, where it is at the model's start, from what is not it."""
    features = model.observe(image)
    own = float(model.log_likelihood(model.start[None], features)[0])
    places = model.given(NOT_YET_FOUND).sample_prior(np.random.default_rng(0), _BACKGROUND_PLACES)[:, 0]
    away = np.hypot(*(places - model.start)[:, :2].T) > model.contour.size
    elsewhere = places[away] if away.any() else places
    return PresenceRule(own, float(np.median(model.log_likelihood(elsewhere, features))))


def learn_features(
    image: Image, contour: Contour, start: FloatArray, working_width: int = WORKING_WIDTH
) -> FeatureExtractor:
    """What tells the object from its background in one BGR ``image``, where ``contour`` lies at ``start (k,)``."""
    size = (image.shape[1], image.shape[0])
    scale = working_scale(size, contour.size, working_width)
    working = working_image(image, scale)
    inside, near = _regions(contour, start[:2], scale, working.shape[:2])
    colours = ColourRatio.learn(working, inside, near)
    ratio = colours.of(working)
    detector = BlobDetector.learn(ratio, contour, start[:2], scale, size)
    threshold = learn_edge_threshold(working, ratio, contour, start, scale)
    reach = int(np.clip(0.2 * contour.size * scale, 5, 14))
    return FeatureExtractor(scale, colours, detector, threshold, reach)


def learn_contour(
    image: Image, box: Box | None, polygon: ArrayLike | None, normals: int = DEFAULT_POINTS
) -> tuple[Contour, FloatArray]:
    """The outline of the object in ``box`` or inside ``polygon``, and its centre ``(2,)`` in the frame."""
    if polygon is not None:
        return contour_from_polygon(polygon, normals)
    if box is None:
        raise ValueError("a box or an outline of the object is needed")
    scale = min(1.0, 96.0 / np.sqrt(box[2] * box[3]))
    x, y, w, h = box
    mask = segment(working_image(image, scale), (x * scale, y * scale, w * scale, h * scale))
    if mask is None:
        return contour_from_box(w, h, count=normals), np.array([x + w / 2, y + h / 2])
    contour, centre = contour_from_mask(mask, normals)
    return Contour(contour.control_points / scale, normals), (centre + 0.5) / scale


def _prior_deviation(dynamics: Autoregression, object_size: float) -> FloatArray:
    """``(2, k)``: of the first state and of its velocity."""
    noise = np.sqrt(np.diag(dynamics.noise_covariance))
    first = np.array([0.02 * object_size, 0.02 * object_size, 0.03, 0.02, 0.02, 0.02])[: len(noise)]
    return readonly(np.stack([first, 1.5 * noise]))


def _regions(
    contour: Contour, centre: FloatArray, scale: float, shape: tuple[int, int]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """``(h, w)`` each: the pixels well inside the outline, and those near it but outside."""

    def filled(factor: float) -> NDArray[np.bool_]:
        mask = np.zeros(shape, np.uint8)
        polygon = (contour.outline() * factor + centre) * scale
        cv2.fillPoly(mask, [np.rint(polygon * 16 - 8).astype(np.int32)], 1, shift=4)
        return mask.astype(bool)

    return filled(0.9), filled(2.0) & ~filled(1.1)
