"""How outlines move: second-order dynamics by name, in the units of a video."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pfviz.dynamics import Autoregression
from pfviz.names import find
from pfviz.particles import FloatArray
from pfviz.vision.options import TrackerOptions
from pfviz.vision.video import DEFAULT_FRAME_RATE

DEFAULT_DYNAMICS = "hand-held"
DYNAMICS = {
    "hand-held": "velocities that fade, driven by noise; scale and stretch drawn back to those of the start",
    "constant-position": "first order: the velocity is noise (Brownian motion)",
    "constant-velocity": "the acceleration is noise; scale and stretch drawn back to those of the start",
    "constrained": "as hand-held, and everything drawn back to where it was at the start",
}
_WALK = 3.0
_HOME = 0.02


@dataclass(frozen=True, slots=True)
class MotionScale:
    """What lengths and times are relative to.

    Attributes:
        size: width and height of the frame in pixels.
        object_size: the side of the square of the object's area, in pixels.
        frame_rate: frames per second.
        dimension: of the shape space: 2, 4 or 6.
    """

    size: tuple[int, int]
    object_size: float
    frame_rate: float
    dimension: int = 4

    @property
    def interval(self) -> float:
        """Between two frames, in units of 1/30 second."""
        return float(np.clip(DEFAULT_FRAME_RATE / self.frame_rate, 0.25, 4.0))

    def deviation(self, options: TrackerOptions) -> FloatArray:
        """``(k,)``: of the noise of each component, which grows with the time between frames."""
        position = options.position_noise * float(np.sqrt(self.object_size * np.hypot(*self.size)))
        stretch = options.stretch_noise
        each = [position, position, options.rotation_noise, options.scale_noise, stretch, stretch]
        return np.array(each[: self.dimension]) * self.interval

    def keep(self, options: TrackerOptions) -> FloatArray:
        """``(k,)``: the part of each velocity that is kept."""
        keep = (*options.keep, options.stretch_keep, options.stretch_keep)
        return np.array(keep[: self.dimension]) ** self.interval

    def spring(self, options: TrackerOptions) -> FloatArray:
        """``(k,)``: the part of each component by which it is drawn back to its mean."""
        springs = [0.0, 0.0, 0.0, options.scale_spring, options.stretch_spring, options.stretch_spring]
        return np.array(springs[: self.dimension]) * self.interval


def make_motion(
    name: str, scale: MotionScale, start: FloatArray, options: TrackerOptions | None = None
) -> Autoregression:
    """The dynamics called ``name`` of an object whose state is ``start (k,)`` at the beginning.

    Raises:
        UnknownName: if there are none of that name.
    """
    find(DYNAMICS, name, "dynamics")
    return _MAKE[name](scale, start, options or TrackerOptions())


def hand_held_motion(
    size: tuple[int, int],
    object_size: float,
    frame_rate: float,
    options: TrackerOptions | None = None,
    dimension: int = 4,
) -> Autoregression:
    """Second-order dynamics of something that a hand moves: velocities that fade, driven by noise.

    Position and rotation keep a part of their velocity; the logarithm of scale does too and is drawn back to
    zero, its mean (the constrained process of Odobez' lecture). The deviation of the noise grows with the
    time between frames.
    """
    scale = MotionScale(size, object_size, frame_rate, dimension)
    return _hand_held(scale, np.zeros(dimension), options or TrackerOptions())


def _damped(keep: FloatArray, spring: FloatArray, deviation: FloatArray, mean: FloatArray) -> Autoregression:
    """Independent components: x_t = x_{t-1} + keep (x_{t-1} - x_{t-2}) - spring (x_{t-1} - mean) + noise."""
    coefficients = np.stack([np.diag(1.0 + keep - spring), np.diag(-keep)])
    return Autoregression(coefficients, np.diag(deviation**2), mean)


def _hand_held(scale: MotionScale, start: FloatArray, options: TrackerOptions) -> Autoregression:
    return _damped(scale.keep(options), scale.spring(options), scale.deviation(options), np.zeros(len(start)))


def _constant_position(scale: MotionScale, start: FloatArray, options: TrackerOptions) -> Autoregression:
    walk = _WALK * scale.deviation(options)
    coefficients = np.diag(1.0 - scale.spring(options))[None]
    return Autoregression(coefficients, np.diag(walk**2), np.zeros(len(start)))


def _constant_velocity(scale: MotionScale, start: FloatArray, options: TrackerOptions) -> Autoregression:
    keep = np.where(np.arange(len(start)) < 3, 1.0, scale.keep(options))
    return _damped(keep, scale.spring(options), scale.deviation(options), np.zeros(len(start)))


def _constrained(scale: MotionScale, start: FloatArray, options: TrackerOptions) -> Autoregression:
    spring = np.maximum(scale.spring(options), _HOME * scale.interval)
    return _damped(scale.keep(options), spring, scale.deviation(options), start)


_MAKE: dict[str, Callable[[MotionScale, FloatArray, TrackerOptions], Autoregression]] = {
    "hand-held": _hand_held,
    "constant-position": _constant_position,
    "constant-velocity": _constant_velocity,
    "constrained": _constrained,
}


def joined_motion(own: Autoregression, rest: Autoregression) -> Autoregression:
    """``own`` dynamics for the first components and those of ``rest`` for the others, independent of each other.

    Dynamics learnt from positions alone become those of a whole shape space in this way.

    Raises:
        ValueError: if ``own`` has more components than ``rest``.
    """
    d, k = own.dimension, rest.dimension
    if d == k:
        return own
    if d > k:
        raise ValueError(f"dynamics: of {d} components, but the shape space has {k}")
    order = max(own.order, rest.order)
    coefficients = np.zeros((order, k, k))
    coefficients[: rest.order, d:, d:] = rest.coefficients[:, d:, d:]
    coefficients[: own.order, :d, :d] = own.coefficients
    covariance = np.array(rest.noise_covariance)
    covariance[:d, :], covariance[:, :d] = 0.0, 0.0
    covariance[:d, :d] = own.noise_covariance
    mean = np.concatenate([np.asarray(own.mean), np.asarray(rest.mean)[d:]])
    return Autoregression(coefficients, covariance, mean)
