"""What is measured of a frame: edges of lightness and of colour, at the working size."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pfviz.vision.colour import encode
from pfviz.vision.features import find_edges, learn_edge_threshold, working_image, working_scale
from pfviz.vision.shapes import contour_from_polygon

SHAPE = (120, 160)


def disc() -> np.ndarray:
    y, x = np.mgrid[0 : SHAPE[0], 0 : SHAPE[1]] + 0.5
    return np.hypot(x - 80, y - 60) < 30


def picture(light: float, dark: float) -> np.ndarray:
    return np.repeat(np.where(disc(), light, dark).astype(np.uint8)[..., None], 3, axis=2)


def grey(image: np.ndarray) -> np.ndarray:
    return cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)


def distances_to_the_rim(edges: np.ndarray) -> np.ndarray:
    rows, columns = np.nonzero(edges)
    return np.abs(np.hypot(columns + 0.5 - 80, rows + 0.5 - 60) - 30)


NO_RATIO = encode(np.zeros(SHAPE))


@pytest.mark.parametrize(
    ("image", "ratio"),
    [
        (picture(180, 60), NO_RATIO),
        (picture(100, 100), encode(np.where(disc(), 2.0, -2.0))),
    ],
    ids=["lightness", "colour"],
)
def test_an_edge_of_lightness_or_of_colour_is_an_edge(image, ratio):
    edges = find_edges(grey(image), ratio, 150.0)
    distances = distances_to_the_rim(edges)
    assert len(distances) > 150
    assert distances.max() < 1.5


def test_edges_weaker_than_the_threshold_are_none():
    assert not find_edges(grey(picture(110, 100)), NO_RATIO, 150.0).any()


def test_the_threshold_is_half_of_the_gradient_on_the_outline():
    turn = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    contour, _ = contour_from_polygon(30.0 * np.stack([np.cos(turn), np.sin(turn)], axis=1))
    start = np.array([80.0, 60.0, 0.0, 0.0])
    weak, strong = (learn_edge_threshold(picture(l, 60), NO_RATIO, contour, start, 1.0) for l in (120, 180))
    assert strong == pytest.approx(2.0 * weak, rel=0.05)
    step = cv2.Sobel(cv2.GaussianBlur(np.repeat([[60.0, 180.0]], 40, axis=1), (0, 0), 1.0), cv2.CV_64F, 1, 0)
    assert strong == pytest.approx(0.5 * step.max(), rel=0.15)
    assert learn_edge_threshold(picture(100, 100), NO_RATIO, contour, start, 1.0) == 60.0


@pytest.mark.parametrize(
    ("size", "object_size", "scale"),
    [
        ((240, 180), 34.0, 1.0),
        ((640, 480), 150.0, 1 / 2),
        ((1920, 1080), 200.0, 1 / 6),
        ((1920, 1080), 48.0, 1 / 2),
        ((128, 96), 30.0, 1.0),
    ],
)
def test_large_frames_are_shrunk_and_small_objects_are_not_lost(size, object_size, scale):
    assert working_scale(size, object_size) == pytest.approx(scale)
    assert object_size * working_scale(size, object_size) > 20.0


def test_the_working_image_is_the_mean_of_the_pixels():
    image = np.random.default_rng(0).integers(0, 256, (40, 60, 3)).astype(np.uint8)
    means = image.reshape(20, 2, 30, 2, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(working_image(image, 0.5), means, atol=1.0)
    assert working_image(image, 1.0) is image


def test_edges_are_those_of_canny_on_both_channels():
    """OpenCV takes three channels or one; with the ratio twice it does the choosing itself."""
    rng = np.random.default_rng(3)
    grey, ratio = (cv2.blur(rng.integers(0, 256, (60, 80)).astype(np.uint8), (5, 5)) for _ in range(2))
    channels = cv2.GaussianBlur(cv2.merge([grey, ratio, ratio]), (0, 0), 1.0)
    dx, dy = cv2.Sobel(channels, cv2.CV_16S, 1, 0), cv2.Sobel(channels, cv2.CV_16S, 0, 1)
    for threshold in (60.0, 120.0):
        expected = cv2.Canny(dx, dy, 0.4 * threshold, threshold, L2gradient=True)
        assert expected.any()
        np.testing.assert_array_equal(find_edges(grey, ratio, threshold), expected)
