"""Learning an outline: it follows the object where that is clear, and falls back on the box where it is not."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pfviz.vision.segmentation import _grab_cut, box_error, segment
from pfviz.vision.tracker import learn_contour

SIZE = (160, 120)


def noisy(image: np.ndarray, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.clip(image + rng.normal(0, 6, image.shape), 0, 255).astype(np.uint8)


def leaf() -> tuple[np.ndarray, tuple[float, float, float, float], np.ndarray]:
    """A green leaf on a board of many colours, its tight box, and its mask."""
    rng = np.random.default_rng(1)
    image = cv2.resize(rng.integers(60, 200, (12, 16, 3)).astype(np.uint8), SIZE, interpolation=cv2.INTER_NEAREST)
    mask = np.zeros((SIZE[1], SIZE[0]), np.uint8)
    cv2.ellipse(mask, (80, 60), (34, 15), 30, 0, 360, 1, -1)
    image[mask > 0] = (30, 235, 40)
    x, y, w, h = cv2.boundingRect(cv2.findNonZero(mask))
    return noisy(image), (x, y, w, h), mask


def test_the_mask_follows_the_object_and_not_the_box():
    image, box, truth = leaf()
    mask = segment(image, box)
    assert mask is not None
    overlap = np.logical_and(mask, truth).sum() / np.logical_or(mask, truth).sum()
    box_overlap = truth.sum() / (box[2] * box[3])
    assert overlap > 0.85 > box_overlap + 0.2


def test_the_outline_is_that_of_the_mask_in_frame_pixels():
    image, box, truth = leaf()
    large = cv2.resize(image, None, fx=3.0, fy=3.0, interpolation=cv2.INTER_LINEAR)
    contour, centre = learn_contour(large, tuple(3.0 * side for side in box), None)
    np.testing.assert_allclose(centre, [3 * 80.5, 3 * 60.5], atol=4.0)
    assert contour.size == pytest.approx(3 * np.sqrt(truth.sum()), rel=0.08)


@pytest.mark.parametrize("level", [0, 128, 255])
def test_where_nothing_can_be_told_apart_the_outline_is_a_rounded_box(level):
    image = np.full((SIZE[1], SIZE[0], 3), level, np.uint8)
    contour, centre = learn_contour(image, (40.0, 30.0, 60.0, 40.0), None)
    np.testing.assert_allclose(centre, [70.0, 50.0], atol=1.0)
    assert contour.bounding_box(np.array([70.0, 50.0, 0.0, 0.0])) == pytest.approx((40, 30, 60, 40), abs=3.0)


@pytest.mark.parametrize(
    "box", [(0, 0, 160, 120), (0, 0, 40, 30), (130, 100, 40, 30), (-10, 40, 40, 30), (100.4, 60.7, 20.2, 9.9)]
)
def test_any_box_that_fits_gives_an_outline(box):
    image, *_ = leaf()
    contour, centre = learn_contour(image, box, None)
    assert 0.2 * box[2] * box[3] < contour.size**2 < 1.1 * box[2] * box[3]
    assert np.abs(centre - [box[0] + box[2] / 2, box[1] + box[3] / 2]).max() < 0.5 * max(box[2], box[3])


@pytest.mark.parametrize("seed", range(6))
def test_the_same_frame_gives_the_same_outline_whatever_was_drawn_before(seed):
    """On frames without a clear object, where the segmentation depends on how it begins."""
    rng = np.random.default_rng(seed)
    clouds = cv2.GaussianBlur(rng.normal(128.0, 500.0, (80, 100, 3)), (0, 0), 3.0)
    image = np.clip(clouds, 0, 255).astype(np.uint8)
    outlines = []
    for state in (1, 2, 3):
        cv2.setRNGSeed(state)
        outlines.append(_grab_cut(image, (20, 20, 50, 40)))
    np.testing.assert_array_equal(outlines[0], outlines[1])
    np.testing.assert_array_equal(outlines[0], outlines[2])


@pytest.mark.parametrize(
    ("box", "trouble"),
    [
        ((10, 10, 0, 5), "must be positive"),
        ((10, 10, 5, -5), "must be positive"),
        ((10, 10, 3, 50), "too small"),
        ((200, 10, 20, 20), "centre lies outside"),
        ((10, -50, 20, 20), "centre lies outside"),
        ((-100, -100, 360, 320), "larger than"),
        ((float("nan"), 10, 20, 20), "finite"),
    ],
)
def test_a_box_that_makes_no_sense_is_named_with_the_frame(box, trouble):
    problem = box_error(box, SIZE)
    assert problem is not None
    assert trouble in problem
    assert f"box {box[0]:g},{box[1]:g},{box[2]:g},{box[3]:g}" in problem
    assert "\n" not in problem


@pytest.mark.parametrize("box", [(0, 0, 160, 120), (150, 110, 20, 20), (-5, -5, 30, 30)])
def test_a_box_may_reach_over_the_border(box):
    assert box_error(box, SIZE) is None
