"""Synthetic videos whose truth is known exactly.

``twin`` is the experiment of the sources (section 3) drawn anew: 5 seconds at 30 frames per second and 240 x
180 pixels of an artificial object, moved as by a hand through a cluttered office, while another of the same
shape and colour lies on the table. Everything in it follows from its seed: other seeds give other motions,
clutter and places of the twin. ``twin-small``, ``twin-fast`` and the others of ``VARIANTS`` change one thing each.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial

import cv2
import numpy as np
from numpy.typing import NDArray

from pfviz.names import find
from pfviz.particles import FloatArray
from pfviz.vision.office import paint_office
from pfviz.vision.shapes import apply, centroid, transforms
from pfviz.vision.video import Box, EndOfVideo, Image, Truth, VideoError

SIZE = (240, 180)
FRAME_RATE = 30.0
FRAME_COUNT = 150

_COLOUR = np.array([96.0, 40.0, 214.0])
_RADIUS = 17.0
_FINE = 4
_EXPOSURE = 0.35
_NOISE = 2.2
_TABLE = (134.0, 160.0)
_PASSING_DISTANCE = (8.0, 18.0)
_PASSING_SPEED = 3.0


def make_scene(text: str) -> Scene:
    """The scene called ``NAME`` or ``NAME:SEED``.

    Raises:
        UnknownName: if there is no such scene; the message suggests the nearest.
        VideoError: if the seed is not a whole number.
    """
    name, _, seed = text.partition(":")
    make = find(SCENES, name, "scene")
    if seed and not seed.isdecimal():
        raise VideoError(f"scene:{text}: the seed must be a whole number, got '{seed}'")
    return make(int(seed or 0))


@dataclass(frozen=True, slots=True)
class Variant:
    """What a scene does differently from ``twin``.

    Attributes:
        object_size: the size of object and twin, relative to that of ``twin``.
        speed: of the motion, relative.
        passing: the least and the greatest distance in pixels at which the object's centre passes by the twin's.
        patches: how many smaller things of the object's colour lie about.
    """

    object_size: float = 1.0
    speed: float = 1.0
    passing: tuple[float, float] = _PASSING_DISTANCE
    patches: int = 0


@dataclass(frozen=True)
class Motion:
    """States ``(x, y, rotation, log_scale)`` over time, each a sum of sines about a mean.

    Attributes:
        mean: ``(4,)``.
        amplitudes: ``(4, s)``.
        frequencies: ``(4, s)``, in hertz.
        phases: ``(4, s)``, in radians.
    """

    mean: FloatArray
    amplitudes: FloatArray
    frequencies: FloatArray
    phases: FloatArray

    def at(self, seconds: FloatArray) -> FloatArray:
        """``(n, 4)``: the states at ``seconds (n,)``."""
        angles = 2.0 * np.pi * self.frequencies * seconds[:, None, None] + self.phases
        return self.mean + np.sum(self.amplitudes * np.sin(angles), axis=2)


class Scene:
    """A synthetic video source with ground truth; see ``pfviz.vision.video.VideoSource``.

    Frames are drawn when they are asked for, and kept.

    Attributes:
        twin: ``(4,)``, the state of the object on the table.
    """

    size = SIZE
    frame_rate = FRAME_RATE
    frame_count = FRAME_COUNT

    def __init__(self, seed: int = 0, kind: str = "twin") -> None:
        self.name = f"scene:{kind}:{seed}" if seed else f"scene:{kind}"
        self._seed, self._variant = seed, VARIANTS[kind]
        self._motion, self.twin = _choreography(np.random.default_rng([seed, 0]), self._variant)
        self._frames: dict[int, Image] = {}

    def read(self, index: int) -> Image:
        self._check(index)
        if index not in self._frames:
            frame = self._draw(index)
            frame.flags.writeable = False
            self._frames[index] = frame
        return self._frames[index]

    def state(self, index: int) -> FloatArray:
        """``(4,)``: the object's state in frame ``index``, its scale relative to the twin's shape."""
        self._check(index)
        return self._motion.at(np.array([index / FRAME_RATE]))[0]

    def truth(self, index: int) -> Truth:
        """``(x, y, rotation, scale)`` of the object in frame ``index``, the last two relative to frame 0."""
        x, y, rotation, log_scale = self.state(index)
        _, _, first_rotation, first_log_scale = self.state(0)
        return (
            float(x),
            float(y),
            float(rotation - first_rotation),
            float(np.exp(log_scale - first_log_scale)),
        )

    def outline(self, index: int) -> FloatArray:
        """``(n, 2)``: the object's true outline in frame ``index``."""
        return _placed(self.state(index))

    def box(self, index: int) -> Box:
        """The object's true bounding box ``(x, y, width, height)`` in frame ``index``."""
        low, high = self.outline(index).min(axis=0), self.outline(index).max(axis=0)
        return float(low[0]), float(low[1]), float(high[0] - low[0]), float(high[1] - low[1])

    def close(self) -> None:
        self._frames.clear()

    def __enter__(self) -> Scene:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    @staticmethod
    def _check(index: int) -> None:
        if not 0 <= index < FRAME_COUNT:
            raise EndOfVideo(f"there is no frame {index}: the scene has {FRAME_COUNT}")

    @cached_property
    def _table(self) -> NDArray[np.float32]:
        """What does not move: the office with the patches in it, and the twin on the table."""
        canvas = paint_office(np.random.default_rng([self._seed, 1]), SIZE)
        for patch in self._patches():
            draw_object(canvas, patch[None])
        draw_shadow(canvas, self.twin, offset=(2.0, 3.5), softness=2.0, depth=0.5)
        draw_object(canvas, self.twin[None])
        return canvas

    def _patches(self) -> FloatArray:
        """``(n, 4)``: the states of the patches, which keep away from where the object begins and from the twin."""
        rng = np.random.default_rng([self._seed, 4])
        places = np.stack([rng.uniform(12.0, side - 12.0, 200) for side in SIZE], axis=1)
        taken = np.stack([self.state(0)[:2], self.twin[:2]])
        apart = np.linalg.norm(places[:, None] - taken, axis=2).min(axis=1) > 45.0
        places = places[apart][: self._variant.patches]
        log_scales = np.log(self._variant.object_size * rng.uniform(0.3, 0.6, len(places)))
        return np.column_stack([places, rng.uniform(-np.pi, np.pi, len(places)), log_scales])

    def _draw(self, index: int) -> Image:
        seconds = (index + _EXPOSURE * np.array([-0.5, 0.0, 0.5])) / FRAME_RATE
        states = self._motion.at(seconds)
        canvas = self._table.copy()
        draw_shadow(canvas, states[1], offset=(9.0, 12.0), softness=5.0, depth=0.22)
        draw_stick(canvas, states[1])
        draw_object(canvas, states)
        canvas = cv2.GaussianBlur(canvas, (0, 0), 0.6)
        canvas += self._sensor_noise(index)
        return np.clip(canvas + 0.5, 0, 255).astype(np.uint8)

    def _sensor_noise(self, index: int) -> NDArray[np.float32]:
        """``(h, w, 3)``: another cut-out of a large field of noise for each frame."""
        left, top = np.random.default_rng([self._seed, 3, index]).integers(0, SIZE)
        return self._noise[top : top + SIZE[1], left : left + SIZE[0]]

    @cached_property
    def _noise(self) -> NDArray[np.float32]:
        rng = np.random.default_rng([self._seed, 2])
        return _NOISE * rng.standard_normal((2 * SIZE[1], 2 * SIZE[0], 3), dtype=np.float32)


VARIANTS: dict[str, Variant] = {
    "twin": Variant(),
    "twin-small": Variant(object_size=0.6),
    "twin-large": Variant(object_size=1.4),
    "twin-fast": Variant(speed=1.6),
    "twin-near": Variant(passing=(0.0, 8.0)),
    "twin-patches": Variant(patches=8),
}
SCENES: dict[str, Callable[[int], Scene]] = {name: partial(Scene, kind=name) for name in VARIANTS}


@lru_cache(maxsize=1)
def shape() -> FloatArray:
    """``(96, 2)``: the outline of object and twin about its centroid, in pixels at scale 1."""
    angles = np.linspace(0.0, 2.0 * np.pi, 96, endpoint=False)
    radii = 1.0 + 0.15 * np.cos(2 * angles + 0.4) + 0.14 * np.cos(3 * angles - 1.1) + 0.05 * np.cos(5 * angles)
    outline = _RADIUS * radii[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return outline - centroid(outline)


def _placed(state: FloatArray) -> FloatArray:
    return apply(transforms(state[None]), shape())[0]


def _choreography(rng: np.random.Generator, variant: Variant) -> tuple[Motion, FloatArray]:
    """A motion, and the state of a twin on the table that it starts away from and sweeps across later."""
    seconds = np.arange(FRAME_COUNT) / FRAME_RATE
    for _ in range(10_000):
        motion = _hand_motion(rng, variant)
        path = motion.at(seconds)[:, :2]
        velocity = np.gradient(path, axis=0)
        speed = np.linalg.norm(velocity, axis=1)
        passing = int(rng.integers(40, FRAME_COUNT - 25))
        aside = np.array([-velocity[passing, 1], velocity[passing, 0]]) / speed[passing]
        position = path[passing] + rng.choice([-1.0, 1.0]) * rng.uniform(*variant.passing) * aside
        twin = np.array([*position, rng.uniform(-np.pi, np.pi), rng.uniform(-0.08, 0.08)])
        twin[3] += np.log(variant.object_size)
        distances = np.linalg.norm(path - position, axis=1)
        if (
            _within_frame(path)
            and _TABLE[0] < position[1] < _TABLE[1]
            and speed[passing] > _PASSING_SPEED
            and distances[:20].min() > 55.0
            and distances.min() >= variant.passing[0]
        ):
            return motion, twin
    raise AssertionError("no motion was found that passes by the twin")


def _within_frame(path: FloatArray) -> bool:
    return bool((path >= [26.0, 26.0]).all() and (path <= [SIZE[0] - 26.0, SIZE[1] - 26.0]).all())


def _hand_motion(rng: np.random.Generator, variant: Variant) -> Motion:
    """Slow sweeps, quicker ones on top, and a little shaking."""
    amplitudes = np.array([[62.0, 22.0, 3.5], [42.0, 16.0, 3.0], [0.55, 0.3, 0.05], [0.16, 0.05, 0.005]])
    centre = [rng.uniform(105.0, 135.0), rng.uniform(90.0, 102.0), rng.uniform(-0.5, 0.5), np.log(variant.object_size)]
    return Motion(
        mean=np.array(centre),
        amplitudes=amplitudes * rng.uniform(0.75, 1.15, amplitudes.shape),
        frequencies=variant.speed * np.array([0.32, 0.75, 1.9]) * rng.uniform(0.8, 1.2, amplitudes.shape),
        phases=rng.uniform(0.0, 2.0 * np.pi, amplitudes.shape),
    )


def _window(canvas: NDArray[np.float32], outline: FloatArray, margin: float) -> tuple[slice, slice]:
    """Rows and columns of the part of the canvas about ``outline``."""
    height, width = canvas.shape[:2]
    left, top = np.clip(np.floor(outline.min(axis=0) - margin), 0, [width, height]).astype(int)
    right, bottom = np.clip(np.ceil(outline.max(axis=0) + margin), 0, [width, height]).astype(int)
    return slice(top, bottom), slice(left, right)


def coverage(outline: FloatArray, rows: slice, columns: slice) -> NDArray[np.float32]:
    """``(h, w)``: the part of each pixel of a window that lies inside ``outline (n, 2)``."""
    height, width = rows.stop - rows.start, columns.stop - columns.start
    mask = np.zeros((height * _FINE, width * _FINE), np.uint8)
    fine = (outline - [columns.start, rows.start]) * _FINE - 0.5
    cv2.fillPoly(mask, [np.rint(fine * 16).astype(np.int32)], 255, cv2.LINE_AA, shift=4)
    return cv2.resize(mask, (width, height), interpolation=cv2.INTER_AREA).astype(np.float32) / 255.0


def draw_object(canvas: NDArray[np.float32], states: FloatArray) -> None:
    """Paint the object, as seen during an exposure in which it passes through ``states (n, 4)``, n odd."""
    outlines = apply(transforms(states), shape())
    rows, columns = _window(canvas, outlines.reshape(-1, 2), 2.0)
    alpha = np.mean([coverage(outline, rows, columns) for outline in outlines], axis=0)[..., None]
    window = canvas[rows, columns]
    window += alpha * (_shaded(states[len(states) // 2], rows, columns) - window)


def _shaded(state: FloatArray, rows: slice, columns: slice) -> NDArray[np.float32]:
    """``(h, w, 3)``: the object's surface: lit from the upper left, with a pale spot that turns with it."""
    y, x = np.mgrid[rows, columns].astype(np.float32) + np.float32(0.5)
    unit = _RADIUS * np.exp(state[3])
    u, v = (x - state[0]) / unit, (y - state[1]) / unit
    light = np.clip(1.0 - 0.16 * (u + v) - 0.12 * (u * u + v * v), 0.55, 1.25)[..., None]
    shine = np.exp(-((u + 0.38) ** 2 + (v + 0.45) ** 2) / 0.05)[..., None]
    cosine, sine = np.cos(state[2]), np.sin(state[2])
    along, across = cosine * u + sine * v - 0.35, cosine * v - sine * u
    spot = np.clip(4.0 - 14.0 * np.hypot(along, across), 0.0, 1.0)[..., None]
    colour = _COLOUR + spot * (np.array([170.0, 140.0, 236.0]) - _COLOUR)
    return (colour * light + 70.0 * shine).astype(np.float32)


def draw_shadow(
    canvas: NDArray[np.float32], state: FloatArray, offset: tuple[float, float], softness: float, depth: float
) -> None:
    """Darken what lies behind the object."""
    outline = _placed(state) + offset
    rows, columns = _window(canvas, outline, 3.0 * softness)
    if rows.start < rows.stop and columns.start < columns.stop:
        shade = cv2.GaussianBlur(coverage(outline, rows, columns), (0, 0), softness)
        canvas[rows, columns] *= (1.0 - depth * shade)[..., None]


def draw_stick(canvas: NDArray[np.float32], state: FloatArray) -> None:
    """The thin stick that the object is held by, from below the frame."""
    x, y = state[:2]
    foot = np.array([0.55 * x + 0.45 * SIZE[0] * 0.62, SIZE[1] + 12.0])
    across = np.array([foot[1] - y, x - foot[0]])
    across *= 1.6 / np.linalg.norm(across)
    outline = np.array([state[:2] - across, state[:2] + across, foot + 1.4 * across, foot - 1.4 * across])
    rows, columns = _window(canvas, outline, 2.0)
    alpha = coverage(outline, rows, columns)[..., None]
    window = canvas[rows, columns]
    window += alpha * (np.array([70.0, 74.0, 80.0], np.float32) - window)
