"""The measurements of regions: compiled and plain, against loops over pixels that anybody can read."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from pfviz.kernels import (
    NO_BIN,
    normalised,
    patch_correlations,
    patch_correlations_numpy,
    patch_values,
    region_affinities,
    region_affinities_numpy,
    weighted_sums,
    weighted_sums_numpy,
)

RNG = np.random.default_rng(0)
IMAGE = RNG.integers(0, 256, (30, 40), dtype=np.uint8)
BINS = np.where(RNG.random((30, 40)) < 0.1, NO_BIN, RNG.integers(0, 12, (30, 40))).astype(np.uint8)
POINTS = RNG.uniform(-8.0, 8.0, (23, 2))
STARTS = np.array([0, 9, 23])


def some_transforms(count: int) -> np.ndarray:
    """Turned, scaled and sheared; some half, some wholly outside of the image."""
    linear = RNG.normal(0.0, 0.8, (count, 2, 2))
    return np.concatenate([linear, RNG.uniform(-15.0, 55.0, (count, 2, 1))], axis=2)


TRANSFORMS = some_transforms(60)


def pixels_under(image: np.ndarray, transform: np.ndarray) -> Iterator[int]:
    for x, y in POINTS:
        u, v = transform[:, :2] @ [x, y] + transform[:, 2]
        column = min(max(int(np.floor(u)), 0), image.shape[1] - 1)
        row = min(max(int(np.floor(v)), 0), image.shape[0] - 1)
        yield int(image[row, column])


@pytest.mark.parametrize("function", [weighted_sums, weighted_sums_numpy])
def test_sums_are_those_of_the_pixels_under_the_points(function):
    weights = RNG.normal(size=len(POINTS))
    expected = [np.dot(list(pixels_under(IMAGE, t)), weights) for t in TRANSFORMS]
    np.testing.assert_allclose(function(IMAGE, TRANSFORMS, POINTS, weights), expected)


@pytest.mark.parametrize("function", [region_affinities, region_affinities_numpy])
def test_affinities_are_bhattacharyya_coefficients(function):
    references = RNG.dirichlet(np.ones(12), 2)
    expected = []
    for transform in TRANSFORMS:
        values = np.array(list(pixels_under(BINS, transform)))
        total = 0.0
        for region, (start, stop) in enumerate([(0, 9), (9, 23)]):
            for b in range(12):
                share = np.mean(values[start:stop] == b)
                total += np.sqrt(share * references[region, b])
        expected.append(total / 2)
    np.testing.assert_allclose(function(BINS, TRANSFORMS, POINTS, STARTS, references), expected)


@pytest.mark.parametrize("function", [region_affinities, region_affinities_numpy])
def test_a_region_is_wholly_like_itself_and_not_at_all_like_another(function):
    plain = np.full((30, 40), 3, np.uint8)
    inside = np.array([[[1.0, 0.0, 20.0], [0.0, 1.0, 15.0]]])
    own, other = np.eye(12)[[3, 3]], np.eye(12)[[4, 4]]
    assert function(plain, inside, POINTS, STARTS, own)[0] == pytest.approx(1.0)
    assert function(plain, inside, POINTS, STARTS, other)[0] == 0.0
    assert function(np.full_like(plain, NO_BIN), inside, POINTS, STARTS, own)[0] == 0.0


@pytest.mark.parametrize("function", [patch_correlations, patch_correlations_numpy])
def test_correlations_are_pearsons(function):
    template = RNG.normal(size=len(POINTS))
    expected = []
    for transform in TRANSFORMS:
        values = np.array(list(pixels_under(IMAGE, transform)), dtype=float)
        expected.append(np.corrcoef(values, template)[0, 1] if np.ptp(values) > 0 else 0.0)
    measured = function(IMAGE, TRANSFORMS, POINTS, normalised(template))
    np.testing.assert_allclose(measured, expected, atol=1e-9)


@pytest.mark.parametrize("function", [patch_correlations, patch_correlations_numpy])
def test_a_patch_is_fully_correlated_with_itself_whatever_the_light(function):
    template = normalised(patch_values(IMAGE, TRANSFORMS[3], POINTS))
    assert function(IMAGE, TRANSFORMS[3:4], POINTS, template)[0] == pytest.approx(1.0)
    dimmer = (0.5 * IMAGE + 40).astype(np.uint8)
    assert function(dimmer, TRANSFORMS[3:4], POINTS, template)[0] == pytest.approx(1.0, abs=1e-3)
    assert function(255 - IMAGE, TRANSFORMS[3:4], POINTS, template)[0] == pytest.approx(-1.0)


@pytest.mark.parametrize("function", [patch_correlations, patch_correlations_numpy])
def test_a_flat_patch_is_correlated_with_nothing(function):
    flat = np.full((30, 40), 90, np.uint8)
    assert not function(flat, TRANSFORMS, POINTS, normalised(np.arange(23.0))).any()
    assert not normalised(np.full(5, 7.0)).any()


@pytest.mark.parametrize("strange", [np.nan, np.inf, -np.inf, 1e300])
def test_strange_transforms_are_measured_on_the_border(strange):
    transforms = np.full((2, 2, 3), strange)
    for function in (weighted_sums, weighted_sums_numpy):
        sums = function(np.full((5, 6), 7, np.uint8), transforms, POINTS, np.full(len(POINTS), 1 / len(POINTS)))
        np.testing.assert_allclose(sums, 7.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((BINS, TRANSFORMS, POINTS, [0, 9], np.ones((2, 3))), "starts must have shape"),
        ((BINS, TRANSFORMS, POINTS, [0, 9, 9], np.ones((2, 3))), "starts must rise from 0 to 23"),
        ((BINS, TRANSFORMS, POINTS, [0, 23, 23], np.ones((2, 3))), "starts must rise from 0 to 23"),
        ((BINS, TRANSFORMS, POINTS, STARTS, -np.ones((2, 3))), "references must be"),
        ((BINS, TRANSFORMS, POINTS, STARTS, np.ones((2, 256))), "references must be"),
        ((BINS, np.zeros((3, 3)), POINTS, STARTS, np.ones((2, 3))), "transforms must have shape"),
        ((np.zeros((0, 3)), TRANSFORMS, POINTS, STARTS, np.ones((2, 3))), "image must have pixels"),
    ],
)
@pytest.mark.parametrize("function", [region_affinities, region_affinities_numpy])
def test_bad_regions_are_named(function, arguments, message):
    with pytest.raises(ValueError, match=message):
        function(*arguments)


def test_weights_and_template_must_match_the_points():
    with pytest.raises(ValueError, match=r"weights must have shape \(23\)"):
        weighted_sums(IMAGE, TRANSFORMS, POINTS, np.ones(3))
    with pytest.raises(ValueError, match=r"template must have shape \(23\)"):
        patch_correlations(IMAGE, TRANSFORMS, POINTS, np.ones(3))
