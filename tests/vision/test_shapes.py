"""Outlines: geometry that must hold for any shape, and shapes whose outline is known."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given as given_anything
from hypothesis import settings
from hypothesis import strategies as st

from pfviz.vision.shapes import (
    Contour,
    centroid,
    contour_from_box,
    contour_from_mask,
    contour_from_polygon,
    signed_area,
    transforms,
)


def given(*strategies: st.SearchStrategy):
    """As hypothesis' own, with fewer examples."""
    return lambda test: settings(max_examples=50)(given_anything(*strategies)(test))


angles = st.floats(-np.pi, np.pi)
scales = st.floats(0.3, 3.0)
shifts = st.tuples(st.floats(-200, 200), st.floats(-200, 200)).map(np.array)


@st.composite
def blobs(draw: st.DrawFn) -> np.ndarray:
    """Polygons without sharp corners, about (100, 80)."""
    amplitudes = [draw(st.floats(0.0, 0.6 / k**2)) for k in (2, 3, 4)]
    phases = [draw(angles) for _ in range(3)]
    turn = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    waves = [a * np.cos(k * turn + p) for k, a, p in zip((2, 3, 4), amplitudes, phases, strict=True)]
    radii = draw(st.floats(10.0, 80.0)) * (1.0 + sum(waves))
    return np.stack([100.0 + radii * np.cos(turn), 80.0 + radii * np.sin(turn)], axis=1)


def turned(points: np.ndarray, angle: float) -> np.ndarray:
    cosine, sine = np.cos(angle), np.sin(angle)
    return points @ np.array([[cosine, sine], [-sine, cosine]])


def circle(radius: float, points: int = 90) -> np.ndarray:
    turn = np.linspace(0.0, 2.0 * np.pi, points, endpoint=False)
    return radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)


@given(blobs(), angles, scales, shifts)
def test_the_outline_follows_its_shape_through_any_similarity(polygon, angle, scale, shift):
    contour, centre = contour_from_polygon(polygon)
    moved, moved_centre = contour_from_polygon(scale * turned(polygon, angle) + shift)
    tolerance = 1e-7 * contour.size * scale
    np.testing.assert_allclose(moved.points, scale * turned(contour.points, angle), atol=tolerance)
    np.testing.assert_allclose(moved.normals, turned(contour.normals, angle), atol=1e-6)
    np.testing.assert_allclose(moved_centre, scale * turned(centre, angle) + shift, atol=1e-6)


@given(blobs())
def test_normals_are_of_unit_length_and_point_outward(polygon):
    contour, _ = contour_from_polygon(polygon)
    np.testing.assert_allclose(np.linalg.norm(contour.normals, axis=1), 1.0, rtol=1e-12)
    outline = contour.outline(40).astype(np.float32)
    step = 0.01 * contour.size
    for point, normal in zip(contour.points, contour.normals, strict=True):
        assert cv2.pointPolygonTest(outline, tuple(map(float, point + step * normal)), False) < 0
        assert cv2.pointPolygonTest(outline, tuple(map(float, point - step * normal)), False) > 0


@given(blobs(), st.integers(8, 60))
def test_points_are_equally_spaced_along_the_outline(polygon, count):
    contour, _ = contour_from_polygon(polygon, count)
    fine = contour.outline(200)
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(fine, axis=0, append=fine[:1]), axis=1))])
    nearest = [np.argmin(np.linalg.norm(fine - point, axis=1)) for point in contour.points]
    gaps = np.diff(length[nearest], append=length[-1] + length[nearest[0]])
    np.testing.assert_allclose(gaps, length[-1] / count, atol=0.004 * length[-1])


def test_points_are_equally_spaced_where_the_control_points_are_not():
    turn = np.linspace(0.0, 1.0, 24, endpoint=False) ** 2 * 2.0 * np.pi
    contour = Contour(50.0 * np.stack([np.cos(turn), np.sin(turn)], axis=1), count=40)
    gaps = np.linalg.norm(np.roll(contour.points, -1, axis=0) - contour.points, axis=1)
    np.testing.assert_allclose(gaps, gaps.mean(), rtol=0.03)


@given(blobs())
def test_the_direction_in_which_a_polygon_is_clicked_does_not_matter(polygon):
    one, other = contour_from_polygon(polygon)[0], contour_from_polygon(polygon[::-1])[0]
    assert other.size == pytest.approx(one.size, rel=1e-3)
    assert np.einsum("nc,nc->n", other.points, other.normals).mean() > 0


def test_a_circle_stays_a_circle():
    contour, centre = contour_from_polygon(circle(40.0) + np.array([200.0, 100.0]))
    np.testing.assert_allclose(centre, [200.0, 100.0], atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(contour.points, axis=1), 40.0, rtol=2e-3)
    np.testing.assert_allclose(contour.normals, contour.points / 40.0, atol=0.01)


@given(st.floats(-500, 500), st.floats(-500, 500), angles, st.floats(-1, 1))
def test_the_box_of_a_turned_circle_is_a_square_about_its_centre(x, y, rotation, log_scale):
    contour, _ = contour_from_polygon(circle(30.0))
    left, top, width, height = contour.bounding_box(np.array([x, y, rotation, log_scale]))
    diameter = 60.0 * np.exp(log_scale)
    assert (width, height) == pytest.approx((diameter, diameter), rel=0.01)
    assert (left + width / 2, top + height / 2) == pytest.approx((x, y), abs=0.01 * diameter)


def test_a_state_turns_scales_and_shifts_in_that_order():
    quarter = np.array([[10.0, 20.0, np.pi / 2, np.log(2.0)]])
    matrix = transforms(quarter)[0]
    np.testing.assert_allclose(matrix @ [1.0, 0.0, 1.0], [10.0, 22.0], atol=1e-12)  # x goes to y, which is down
    np.testing.assert_allclose(transforms(quarter, 0.5)[0], 0.5 * matrix)


def test_a_box_gives_a_rounded_outline_that_touches_its_sides():
    contour = contour_from_box(80.0, 40.0)
    low, high = contour.outline(20).min(axis=0), contour.outline(20).max(axis=0)
    np.testing.assert_allclose([low, high], [[-40, -20], [40, 20]], rtol=0.03)
    area = signed_area(contour.outline(20))
    assert np.pi / 4 * 3200 < area < 3200


def test_a_mask_gives_the_outline_of_its_largest_part():
    mask = np.zeros((120, 160), np.uint8)
    cv2.ellipse(mask, (90, 50), (40, 22), 25, 0, 360, 255, -1)
    mask[100:104, 10:14] = 255
    contour, centre = contour_from_mask(mask)
    np.testing.assert_allclose(centre, [90, 50], atol=0.3)
    assert signed_area(contour.outline(20)) == pytest.approx(float((mask[:98] > 0).sum()), rel=0.03)


def test_the_centroid_is_that_of_the_area_not_of_the_points():
    crowded = np.array([[0, 0], [1, 0], [2, 0], [3, 0], [4, 0], [4, 2], [0, 2]], dtype=float)
    np.testing.assert_allclose(centroid(crowded), [2.0, 1.0])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: contour_from_polygon([(0, 0), (1, 1)]), "at least 3 points"),
        (lambda: contour_from_polygon([(0, 0), (5, 5), (9, 9)]), "enclose some area"),
        (lambda: contour_from_box(10, 0), "positive sides, got 10 x 0"),
        (lambda: contour_from_mask(np.zeros((9, 9), np.uint8)), "empty"),
        (lambda: Contour(np.zeros((3, 2))), "at least 4 finite points"),
        (lambda: Contour(circle(9.0, 8), count=2), "count must be at least 4, got 2"),
    ],
)
def test_what_is_not_an_outline_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


affine_states = st.tuples(
    *(st.floats(-100, 100) for _ in range(2)), angles, st.floats(-1, 1), *(st.floats(-0.8, 0.8) for _ in range(2))
).map(np.array)


@given(blobs(), affine_states, angles, scales, shifts)
def test_placed_outlines_turn_grow_and_move_with_the_frame(polygon, state, angle, scale, shift):
    """Turning, scaling and moving the picture is turning, scaling and moving the state."""
    contour, _ = contour_from_polygon(polygon)
    moved = np.array(
        [*(scale * turned(state[:2], angle) + shift), state[2] + angle, state[3] + np.log(scale), *state[4:]]
    )
    for k in (4, 6):
        expected = scale * turned(contour.outlines(state[:k])[0], angle) + shift
        np.testing.assert_allclose(contour.outlines(moved[:k])[0], expected, atol=1e-7 * contour.size * scale + 1e-9)


@given(affine_states)
def test_spaces_are_nested(state):
    zeros = np.zeros(2)
    similarity = transforms(state[None, :4])
    np.testing.assert_allclose(transforms(np.concatenate([state[:4], zeros])[None]), similarity, atol=1e-12)
    translation = transforms(state[None, :2], 0.5)
    np.testing.assert_allclose(transforms(np.concatenate([state[:2], zeros])[None], 0.5), translation, atol=1e-12)


@given(affine_states, scales)
def test_stretching_keeps_the_area_and_is_a_matrix_exponential(state, factor):
    from scipy.linalg import expm

    matrix = transforms(state[None], factor)[0]
    p, q = state[4:]
    similar = transforms(state[None, :4], factor)[0]
    np.testing.assert_allclose(matrix[:, :2], similar[:, :2] @ expm(np.array([[p, q], [q, -p]])), atol=1e-9)
    np.testing.assert_allclose(matrix[:, 2], similar[:, 2])
    assert np.linalg.det(matrix[:, :2]) == pytest.approx(factor**2 * np.exp(2 * state[3]))


@given(st.tuples(*(st.floats(-2.0, 2.0) for _ in range(4))).map(lambda v: np.array(v).reshape(2, 2)))
def test_every_affine_map_that_does_not_mirror_is_a_state(linear):
    from scipy.linalg import polar

    if np.linalg.det(linear) < 0.05:
        linear = linear + 3.0 * np.eye(2)
    if np.linalg.det(linear) < 0.05:
        return
    rotation, stretch = polar(linear)
    log_scale = 0.5 * np.log(np.linalg.det(stretch))
    values, vectors = np.linalg.eigh(stretch / np.exp(log_scale))
    (p, q), _ = vectors @ np.diag(np.log(values)) @ vectors.T
    state = np.array([5.0, 7.0, np.arctan2(rotation[1, 0], rotation[0, 0]), log_scale, p, q])
    np.testing.assert_allclose(transforms(state[None])[0, :, :2], linear, atol=1e-6)


@given(blobs(), affine_states)
def test_normals_stay_across_a_stretched_outline(polygon, state):
    """The scan's normal, A^-T m, is at right angles to the tangent that the map makes of the outline's."""
    contour, _ = contour_from_polygon(polygon)
    linear = transforms(state[None])[0, :, :2]
    tangents = np.stack([-contour.normals[:, 1], contour.normals[:, 0]], axis=1) @ linear.T
    normals = contour.normals @ np.linalg.inv(linear)
    cosines = np.sum(tangents * normals, axis=1) / np.linalg.norm(tangents, axis=1) / np.linalg.norm(normals, axis=1)
    np.testing.assert_allclose(cosines, 0.0, atol=1e-9)
