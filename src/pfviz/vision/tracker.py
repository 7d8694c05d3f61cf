"""The tracker's model: how an outline moves, what is proposed from a frame, and how a frame is explained."""

from __future__ import annotations

from dataclasses import dataclass, replace

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
    FeatureExtractor,
    FrameFeatures,
    learn_edge_threshold,
    working_image,
    working_scale,
)
from pfviz.vision.likelihoods import ColourLikelihood, ContourLikelihood
from pfviz.vision.presence import NOT_YET_FOUND, Presence, PresenceRule, weighed_posterior
from pfviz.vision.segmentation import box_error, segment
from pfviz.vision.shapes import (
    DEFAULT_POINTS,
    Contour,
    contour_from_box,
    contour_from_mask,
    contour_from_polygon,
    transforms,
)
from pfviz.vision.video import DEFAULT_FRAME_RATE, Box, Image

DEFAULT_MODEL = "contour+colour"
_ANYWHERE = np.array([0.3, 0.1])
_BACKGROUND_PLACES = 256
MODELS = {
    "contour": "the nearest edge along each normal of the outline (CONDENSATION)",
    "colour": "the object's colours inside the outline, the background's just outside",
    "contour+colour": "the product of the two, taken as independent",
}


@dataclass(frozen=True, slots=True)
class TrackerOptions:
    """What a tracker assumes before it has seen anything. Lengths are relative, so that it works for any
    video.

    Attributes:
        normals: points of the outline that are measured.
        independent_normals: how many of them count as independent; tempers the contour likelihood.
        independent_pixels: how many of the pixels inside and outside count as independent; tempers the colour
            one.
        position_noise: standard deviation of the position's noise at 30 frames per second, relative to the
            geometric mean of the object's size and the frame's diagonal.
        rotation_noise: the same of rotation, in radians.
        scale_noise: the same of the logarithm of scale.
        keep: the part of the velocities of x, y, rotation and log scale kept after 1/30 second.
        scale_spring: the part of the log scale drawn back towards zero in 1/30 second.
    """

    normals: int = 32
    independent_normals: float = 16.0
    independent_pixels: float = 4.0
    position_noise: float = 0.02
    rotation_noise: float = 0.04
    scale_noise: float = 0.015
    keep: tuple[float, float, float, float] = (0.9, 0.9, 0.8, 0.7)
    scale_spring: float = 0.002


@dataclass(frozen=True, slots=True)
class TrackEstimate:
    """Where the object is, in frame pixels.

    Attributes:
        x: of its centre.
        y: of its centre.
        rotation: radians since the start.
        scale: relative to the start.
        box: ``(x, y, width, height)`` of its outline.
    """

    x: float
    y: float
    rotation: float
    scale: float
    box: Box

    @property
    def state(self) -> FloatArray:
        """``(4,)``: as a state of the tracker."""
        return np.array([self.x, self.y, self.rotation, np.log(self.scale)])


@dataclass(frozen=True)
class TrackerModel:
    """A contour tracker: the experiment of the sources (section 3), for any object.

    The state is ``(x, y, rotation, log_scale)``, of second order.

    Attributes:
        name: of the measurement, a key of ``MODELS``.
        contour: the object's outline, in frame pixels.
        size: width and height of the frame.
        start: ``(4,)``, the state in which the outline was learnt.
        dynamics: of the state.
        prior_deviation: ``(2, 4)``, standard deviations of the first state and of its velocity.
        extractor: of what is measured.
        contour_likelihood: of the edges, None where ``name`` does not use it.
        colour_likelihood: of the colours, None where ``name`` does not use it. With both, the two are multiplied.
        presence_rule: when the object counts as lost, and as found.
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
        """``(N,)``: log p(y | x1) for ``innovation (N, 4)``, but for a constant of the frame."""
        matrices = transforms(innovation, self.extractor.working_scale)
        total = np.zeros(len(innovation))
        if self.contour_likelihood is not None:
            total += self.contour_likelihood.log_likelihood(matrices, observation.edge_map)
        if self.colour_likelihood is not None:
            total += self.colour_likelihood.log_likelihood(matrices, observation.ratio)
        return total

    def proposal(self, observation: FrameFeatures) -> GridProposal:
        """The blob detector's answer for the frame: a density of x and y."""
        return observation.proposal

    def sample_prior(self, rng: np.random.Generator, count: int) -> FloatArray:
        """``(count, 2, 4)``: states of the frame before the start, which move on to about ``start``.

        While the model is searching they lie anywhere in the frame, turned and sized a little differently.
        """
        position, velocity = rng.standard_normal((2, count, 4)) * self.prior_deviation[:, None]
        previous = self.start + position - velocity
        if self.searching:
            previous[:, :2] = rng.random((count, 2)) * self.size
            previous[:, 2:] = self.start[2:] + position[:, 2:] * (_ANYWHERE / self.prior_deviation[0, 2:])
        return np.stack([previous, previous - velocity], axis=1)

    def given(self, presence: Presence) -> TrackerModel:
        """The model for the step that follows ``presence``: searching unless the object is tracked."""
        return self if self.searching != presence.tracked else replace(self, searching=not presence.tracked)

    def with_noise(self, system: float = 1.0, observation: float = 1.0, proposal: float = 1.0) -> TrackerModel:
        """The same model with the standard deviations of its noises multiplied by these factors."""
        contour, colour = self.contour_likelihood, self.colour_likelihood
        detector = self.extractor.detector.widened(proposal)
        return replace(
            self,
            dynamics=self.dynamics.with_noise(system),
            contour_likelihood=contour and contour.with_noise(observation),
            colour_likelihood=colour and colour.with_noise(observation),
            extractor=replace(self.extractor, detector=detector),
            presence_rule=self.presence_rule.scaled(observation**-2.0),
        )

    def estimate(self, record: StepRecord) -> TrackEstimate:
        """The mean of the posterior's dominant mode, before any restart; see ``dominant_mean``."""
        return self.estimate_of(dominant_mean(weighed_posterior(record), self.contour.size))

    def score(self, record: StepRecord) -> float:
        """The log-likelihood of the estimate in its frame; NaN where nothing was observed."""
        if record.condition == "missing":
            return float("nan")
        state = self.estimate(record).state
        return float(self.log_likelihood(state[None], record.observation)[0])

    def presence(self, before: Presence, record: StepRecord) -> Presence:
        """Whether the object is tracked or lost after the step of ``record``, from what was believed before it.

        A run begins with ``AT_START``, or with ``NOT_YET_FOUND`` where the object may be absent.
        """
        return self.presence_rule.after(before, self.score(record))

    def estimate_of(self, state: FloatArray) -> TrackEstimate:
        """A ``state (4,)`` in the terms that are reported."""
        x, y, rotation, log_scale = (float(value) for value in state)
        return TrackEstimate(x, y, rotation, float(np.exp(log_scale)), self.contour.bounding_box(state))


def dominant_mean(particles: ParticleSet, reach: float) -> FloatArray:
    """``(4,)``: the weighted mean of the particles about the heaviest place.

    When two objects look alike the posterior has two modes, and its mean lies between them, where nothing is.
    So the particles within ``reach`` pixels of the heaviest place are found by mean shift, from the heaviest
    square of a grid, and only they are averaged. With one mode this is the mean.
    """
    positions, weights = particles.innovation[:, :2], particles.weights
    centre = _heaviest_place(positions, weights, reach)
    near = np.ones(len(weights), dtype=bool)
    for _ in range(10):
        now = np.sum((positions - centre) ** 2, axis=1) <= reach**2
        if not now.any() or (now == near).all():
            break
        near = now
        centre = np.average(positions[near], axis=0, weights=weights[near] + 1e-300)
    return np.average(particles.innovation[near], axis=0, weights=weights[near] + 1e-300)


def _heaviest_place(positions: FloatArray, weights: FloatArray, reach: float) -> FloatArray:
    """``(2,)``: the mean of the particles in the heaviest square of side ``reach``."""
    squares = np.floor((positions - positions.min(axis=0)) / reach).astype(int)
    labels = squares[:, 0] * (squares[:, 1].max() + 1) + squares[:, 1]
    _, labels = np.unique(labels, return_inverse=True)
    heaviest = labels == np.argmax(np.bincount(labels, weights))
    return np.average(positions[heaviest], axis=0, weights=weights[heaviest] + 1e-300)


def learn_tracker(
    image: Image,
    box: Box | None = None,
    polygon: ArrayLike | None = None,
    frame_rate: float = DEFAULT_FRAME_RATE,
    model: str = DEFAULT_MODEL,
    options: TrackerOptions | None = None,
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

    Raises:
        ValueError: if neither box nor polygon is given, or the box does not fit the frame.
        UnknownName: if there is no such model.
    """
    find(MODELS, model, "model")
    options = options or TrackerOptions()
    size = (image.shape[1], image.shape[0])
    if box is not None and (problem := box_error(box, size)):
        raise ValueError(problem)
    contour, centre = learn_contour(image, box, polygon, options.normals)
    start = readonly(np.array([centre[0], centre[1], 0.0, 0.0]))
    dynamics = hand_held_motion(size, contour.size, frame_rate, options)
    extractor = learn_features(image, contour, start)
    normals = ContourLikelihood(
        points=contour.points,
        normals=contour.normals,
        search=extractor.reach,
        sigma=extractor.reach / 1.5,
        temper=options.independent_normals / contour.count,
    )
    tracker = TrackerModel(
        name=model,
        contour=contour,
        size=size,
        start=start,
        dynamics=dynamics,
        prior_deviation=_prior_deviation(dynamics, contour.size),
        extractor=extractor,
        contour_likelihood=normals if "contour" in model else None,
        colour_likelihood=ColourLikelihood.around(contour, options.independent_pixels) if "colour" in model else None,
        presence_rule=PresenceRule(0.0, -1.0),
    )
    return replace(tracker, presence_rule=learn_presence(tracker, image))


def learn_presence(model: TrackerModel, image: Image) -> PresenceRule:
    """The levels of score that tell the object in ``image``, where it is at the model's start, from what is not it."""
    features = model.observe(image)
    own = float(model.log_likelihood(model.start[None], features)[0])
    places = model.given(NOT_YET_FOUND).sample_prior(np.random.default_rng(0), _BACKGROUND_PLACES)[:, 0]
    away = np.hypot(*(places - model.start)[:, :2].T) > model.contour.size
    elsewhere = places[away] if away.any() else places
    return PresenceRule(own, float(np.median(model.log_likelihood(elsewhere, features))))


def learn_features(image: Image, contour: Contour, start: FloatArray) -> FeatureExtractor:
    """What tells the object from its background in one BGR ``image``, where ``contour`` lies at ``start (4,)``."""
    size = (image.shape[1], image.shape[0])
    scale = working_scale(size, contour.size)
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


def hand_held_motion(
    size: tuple[int, int], object_size: float, frame_rate: float, options: TrackerOptions | None = None
) -> Autoregression:
    """Second-order dynamics of something that a hand moves: velocities that fade, driven by noise.

    Position and rotation keep a part of their velocity; the logarithm of scale does too and is drawn back to
    zero, its mean (the constrained process of Odobez' lecture). The deviation of the noise grows with the
    time between frames.
    """
    options = options or TrackerOptions()
    interval = float(np.clip(DEFAULT_FRAME_RATE / frame_rate, 0.25, 4.0))
    keep = np.array(options.keep) ** interval
    spring = np.array([0.0, 0.0, 0.0, options.scale_spring * interval])
    position = options.position_noise * float(np.sqrt(object_size * np.hypot(*size)))
    deviation = np.array([position, position, options.rotation_noise, options.scale_noise]) * interval
    coefficients = np.stack([np.diag(1.0 + keep - spring), np.diag(-keep)])
    return Autoregression(coefficients, np.diag(deviation**2))


def _prior_deviation(dynamics: Autoregression, object_size: float) -> FloatArray:
    """``(2, 4)``: of the first state and of its velocity."""
    noise = np.sqrt(np.diag(dynamics.noise_covariance))
    first = np.array([0.02 * object_size, 0.02 * object_size, 0.03, 0.02])
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
