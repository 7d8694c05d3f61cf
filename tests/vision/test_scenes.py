"""The synthetic scene: the same every time, and its truth is what the pixels show."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pfviz.vision.scenes import FRAME_COUNT, SCENES, SIZE, Scene, shape
from pfviz.vision.shapes import signed_area
from pfviz.vision.video import EndOfVideo, VideoSource


def objects_in(image: np.ndarray) -> list[np.ndarray]:
    """``(n, 2)`` for each connected part of the object's colour: the middles of its pixels."""
    blue, green, red = image.astype(int).transpose(2, 0, 1)
    mask = ((red - green > 70) & (blue - green > 10)).astype(np.uint8)
    mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    count, labels = cv2.connectedComponents(mask)
    parts = [np.argwhere(labels == label)[:, ::-1] + 0.5 for label in range(1, count)]
    return [part for part in parts if len(part) > 200]


def long_axis(points: np.ndarray) -> float:
    _, vectors = np.linalg.eigh(np.cov(points.T))
    return float(np.arctan2(vectors[1, -1], vectors[0, -1]))


def filled(outline: np.ndarray) -> np.ndarray:
    mask = np.zeros((SIZE[1], SIZE[0]), np.uint8)
    cv2.fillPoly(mask, [np.rint((outline - 0.5) * 256).astype(np.int32)], 1, shift=8)
    return np.argwhere(mask)[:, ::-1] + 0.5


def apart(scene: Scene, index: int) -> bool:
    return bool(np.linalg.norm(scene.state(index)[:2] - scene.twin[:2]) > 50.0)


@pytest.mark.parametrize("seed", [0, 7])
def test_the_truth_is_what_the_pixels_show(seed):
    scene = Scene(seed)
    checked = [index for index in range(0, FRAME_COUNT, 10) if apart(scene, index)]
    assert len(checked) >= 4
    for index in checked:
        x, y, *_ = scene.truth(index)
        seen = min(objects_in(scene.read(index)), key=lambda part: np.hypot(*(part.mean(axis=0) - [x, y])))
        np.testing.assert_allclose(seen.mean(axis=0), [x, y], atol=1.0)
        assert np.sqrt(len(seen)) == pytest.approx(np.sqrt(signed_area(scene.outline(index))), rel=0.07)
        turn = long_axis(seen) - long_axis(filled(scene.outline(index)))
        assert abs((turn + np.pi / 2) % np.pi - np.pi / 2) < 0.12


def test_the_twin_on_the_table_is_where_it_is_said_to_be():
    scene = Scene(0)
    seen = min(objects_in(scene.read(0)), key=lambda part: np.hypot(*(part.mean(axis=0) - scene.twin[:2])))
    np.testing.assert_allclose(seen.mean(axis=0), scene.twin[:2], atol=1.0)
    size = np.sqrt(signed_area(shape())) * np.exp(scene.twin[3])
    assert np.sqrt(len(seen)) == pytest.approx(size, rel=0.07)


def test_rotation_and_scale_are_relative_to_the_first_frame():
    scene = Scene(3)
    assert scene.truth(0)[2:] == (0.0, 1.0)
    x, y, rotation, scale = scene.truth(100)
    first = scene.outline(0) - scene.state(0)[:2]
    cosine, sine = scale * np.cos(rotation), scale * np.sin(rotation)
    expected = first @ np.array([[cosine, sine], [-sine, cosine]]) + [x, y]
    np.testing.assert_allclose(scene.outline(100), expected, atol=1e-9)


def test_the_box_encloses_the_outline_tightly():
    scene = Scene(1)
    x, y, w, h = scene.box(20)
    outline = scene.outline(20)
    np.testing.assert_allclose(outline.min(axis=0), [x, y])
    np.testing.assert_allclose(outline.max(axis=0), [x + w, y + h])


def test_equal_seeds_give_equal_frames_in_whatever_order_they_are_read():
    one, other = Scene(5), Scene(5)
    forward = [one.read(index) for index in (0, 60, 149)]
    backward = [other.read(index) for index in (149, 60, 0)][::-1]
    for a, b in zip(forward, backward, strict=True):
        np.testing.assert_array_equal(a, b)


def test_other_seeds_give_other_motions_clutter_and_places():
    one, other = Scene(0), Scene(1)
    assert np.abs(one.state(75) - other.state(75)).max() > 1.0
    assert np.linalg.norm(one.twin[:2] - other.twin[:2]) > 1.0
    shelf = np.s_[10:85, 142:234]
    assert np.abs(one.read(0)[shelf].astype(int) - other.read(0)[shelf]).mean() > 5.0


@pytest.mark.parametrize("seed", range(8))
def test_the_object_starts_away_from_its_twin_and_comes_by_later(seed):
    scene = Scene(seed)
    path = np.array([scene.state(index)[:2] for index in range(FRAME_COUNT)])
    distances = np.linalg.norm(path - scene.twin[:2], axis=1)
    assert distances[:20].min() > 55.0
    assert 7.0 < distances.min() < 19.0
    assert path.min() > 25.0
    assert (path < np.array(SIZE) - 25.0).all()


def test_it_moves_as_a_hand_moves_things():
    scene = Scene(0)
    path = np.array([scene.state(index) for index in range(FRAME_COUNT)])
    assert np.abs(np.diff(path[:, :2], axis=0)).max() < 15.0
    assert np.abs(np.diff(path[:, :2], n=2, axis=0)).max() < 4.0
    assert np.ptp(path[:, 2]) > 0.5
    assert np.ptp(path[:, 3]) > 0.15


def test_it_is_a_video_of_five_seconds():
    scene = Scene(0)
    assert isinstance(scene, VideoSource)
    assert (scene.size, scene.frame_rate, scene.frame_count) == ((240, 180), 30.0, 150)
    frame = scene.read(149)
    assert frame.shape == (180, 240, 3)
    assert frame.dtype == np.uint8
    assert not frame.flags.writeable
    for index in (-1, 150):
        with pytest.raises(EndOfVideo):
            scene.read(index)


def test_a_variant_changes_what_it_is_named_after():
    plain, small, large, fast = (SCENES[name](3) for name in ("twin", "twin-small", "twin-large", "twin-fast"))
    assert small.box(0)[2] < 0.7 * plain.box(0)[2] < 0.7 * large.box(0)[2]
    assert small.truth(0)[3] == large.truth(0)[3] == 1.0
    assert (
        np.abs(np.diff([fast.state(t)[:2] for t in range(150)], axis=0)).sum()
        > 1.3 * np.abs(np.diff([plain.state(t)[:2] for t in range(150)], axis=0)).sum()
    )


@pytest.mark.parametrize("seed", range(4))
def test_the_near_twin_is_passed_over(seed):
    def nearest(scene: Scene) -> float:
        return min(np.linalg.norm(scene.state(t)[:2] - scene.twin[:2]) for t in range(FRAME_COUNT))

    assert nearest(SCENES["twin-near"](seed)) < 8.5 < nearest(SCENES["twin"](seed)) + 0.5


def test_patches_lie_apart_from_object_and_twin_and_are_drawn():
    plain, patched = SCENES["twin"](2), SCENES["twin-patches"](2)
    changed = np.argwhere(np.abs(plain.read(0).astype(int) - patched.read(0)).sum(axis=2) > 150)[:, ::-1]
    assert len(objects_in(patched.read(0))) > len(objects_in(plain.read(0))) + 1
    assert np.linalg.norm(changed - plain.state(0)[:2], axis=1).min() > 25.0
    assert patched.name == "scene:twin-patches:2"
