"""The likelihoods against slow and obvious twins."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from pfviz.kernels import NO_BIN, pad_edges, use_numpy
from pfviz.vision.colour import CODE_ZERO, HSV_BINS, colour_indices, decode, hsv_bins
from pfviz.vision.likelihoods import ColourLikelihood, ContourLikelihood, HistogramLikelihood, MotionLikelihood
from pfviz.vision.shapes import Contour, contour_from_box, transforms


def some_states(rng: np.random.Generator, count: int) -> np.ndarray:
    low, high = [-10, -10, -3, -0.5], [70, 60, 3, 0.5]
    return rng.uniform(low, high, (count, 4))


def placed(state: np.ndarray, point: np.ndarray) -> tuple[float, float]:
    x, y, rotation, log_scale = state
    scale = math.exp(log_scale)
    return (
        x + scale * (math.cos(rotation) * point[0] - math.sin(rotation) * point[1]),
        y + scale * (math.sin(rotation) * point[0] + math.cos(rotation) * point[1]),
    )


def turned(state: np.ndarray, direction: np.ndarray) -> tuple[float, float]:
    cosine, sine = math.cos(state[2]), math.sin(state[2])
    return cosine * direction[0] - sine * direction[1], sine * direction[0] + cosine * direction[1]


def slow_contour_likelihood(likelihood: ContourLikelihood, state: np.ndarray, edges: np.ndarray) -> float:
    """The sum over normals of -temper d^2 / 2 sigma^2, by walking outward pixel by pixel."""
    total = 0.0
    for point, normal in zip(likelihood.points, likelihood.normals, strict=True):
        x, y = placed(state, point)
        dx, dy = turned(state, normal)
        nearest = likelihood.search
        for s in range(-likelihood.search, likelihood.search + 1):
            column, row = math.floor(x + s * dx), math.floor(y + s * dy)
            within = 0 <= row < edges.shape[0] and 0 <= column < edges.shape[1]
            if within and edges[row, column]:
                nearest = min(nearest, abs(s))
        total -= likelihood.temper * nearest**2 / (2 * likelihood.sigma**2)
    return total


def slow_colour_likelihood(likelihood: ColourLikelihood, state: np.ndarray, values: np.ndarray) -> float:
    """The strength times (mean inside - mean outside), looking up one point after the other."""
    sums = {True: [], False: []}
    for point, weight in zip(likelihood.points, likelihood.weights, strict=True):
        x, y = placed(state, point)
        row, column = math.floor(y), math.floor(x)
        within = 0 <= row < values.shape[0] and 0 <= column < values.shape[1]
        sums[bool(weight > 0)].append(values[row, column] if within else 0.0)
    return likelihood.strength * (np.mean(sums[True]) - np.mean(sums[False]))


@pytest.fixture
def contour() -> Contour:
    return contour_from_box(24.0, 16.0, count=20)


@pytest.fixture
def contour_likelihood(contour) -> ContourLikelihood:
    return ContourLikelihood(contour.points, contour.normals, search=5, sigma=2.0, temper=0.3)


@pytest.mark.parametrize("density", [0.0, 0.02, 0.2, 1.0])
def test_the_contour_likelihood_is_that_of_its_definition(contour_likelihood, density):
    rng = np.random.default_rng(0)
    edges = (rng.random((50, 60)) < density).astype(np.uint8)
    states = some_states(rng, 40)
    expected = [slow_contour_likelihood(contour_likelihood, state, edges) for state in states]
    measured = contour_likelihood.log_likelihood(transforms(states), pad_edges(edges, 5))
    np.testing.assert_allclose(measured, expected, atol=1e-9)


def test_the_colour_likelihood_is_that_of_its_definition(contour):
    rng = np.random.default_rng(1)
    likelihood = ColourLikelihood.around(contour, 3.0)
    codes = rng.integers(8, 249, (50, 60)).astype(np.uint8)
    states = some_states(rng, 40)
    expected = [slow_colour_likelihood(likelihood, state, decode(codes)) for state in states]
    padded = np.pad(codes, 1, constant_values=CODE_ZERO)
    np.testing.assert_allclose(likelihood.log_likelihood(transforms(states), padded), expected, atol=1e-9)


def test_points_of_the_colour_likelihood_lie_where_they_should(contour):
    import cv2

    likelihood = ColourLikelihood.around(contour, 1.0)
    outline = contour.outline(20).astype(np.float32)
    for point, weight in zip(likelihood.points, likelihood.weights, strict=True):
        assert (cv2.pointPolygonTest(outline, tuple(map(float, point)), False) > 0) == (weight > 0)
    assert likelihood.weights[likelihood.weights > 0].sum() == pytest.approx(1.0)
    assert likelihood.weights.sum() == pytest.approx(0.0, abs=1e-12)


def test_a_normal_without_an_edge_costs_as_much_as_the_farthest(contour_likelihood):
    cost = contour_likelihood.cost
    assert len(cost) == 7
    assert cost[-1] == cost[-2] == pytest.approx(-0.3 * 25 / 8)
    assert cost[0] == 0.0


def test_more_observation_noise_flattens_both(contour, contour_likelihood):
    np.testing.assert_allclose(contour_likelihood.with_noise(2.0).cost, contour_likelihood.cost / 4)
    assert ColourLikelihood.around(contour, 3.0).with_noise(2.0).strength == pytest.approx(3.0 / 4)


def test_edge_offsets_tell_outward_from_inward(contour):
    likelihood = ContourLikelihood(contour.points, contour.normals, search=5, sigma=2.0, temper=1.0)
    state = np.array([[30.0, 25.0, 0.0, 0.0]])
    edges = np.zeros((50, 60), np.uint8)
    edges[:, 45] = 1  # the right side of the outline is at 42
    offsets = likelihood.edge_offsets(transforms(state), pad_edges(edges, 5))[0]
    rightmost = int(np.argmax(contour.points[:, 0]))
    assert offsets[rightmost] == 3
    assert (offsets == likelihood.search + 1).sum() > 10


def two_coloured(x: float, y: float, rotation: float = 0.0) -> np.ndarray:
    """A BGR frame of 200 x 150 with an ellipse, half red and half blue, on grey."""
    rows, columns = np.mgrid[0:150, 0:200] + 0.5
    u = math.cos(rotation) * (columns - x) + math.sin(rotation) * (rows - y)
    v = math.cos(rotation) * (rows - y) - math.sin(rotation) * (columns - x)
    image = np.full((150, 200, 3), 120, np.uint8)
    inside = (u / 40) ** 2 + (v / 24) ** 2 < 1
    image[inside & (u < 0)] = (30, 30, 220)
    image[inside & (u >= 0)] = (220, 60, 30)
    return image


def bins_of(image: np.ndarray) -> np.ndarray:
    return np.pad(hsv_bins().take(colour_indices(image)), 1, constant_values=NO_BIN)


@pytest.fixture(scope="module")
def histogram() -> HistogramLikelihood:
    placing = transforms(np.array([[90.0, 70.0, 0.0, 0.0]]))[0]
    return HistogramLikelihood.learn(contour_from_box(80, 48, 2.0), bins_of(two_coloured(90, 70)), placing, 20.0)


def slow_squared_distance(likelihood: HistogramLikelihood, state: np.ndarray, bins: np.ndarray) -> float:
    """1 less the mean over the regions of sum_b sqrt(q*_b q_b), one bin after the other."""
    affinities = []
    for region, reference in enumerate(likelihood.references):
        points = likelihood.points[likelihood.starts[region] : likelihood.starts[region + 1]]
        counts = dict.fromkeys(range(HSV_BINS), 0)
        for point in points:
            x, y = placed(state, point)
            if 0 <= x < 200 and 0 <= y < 150:
                counts[int(bins[int(y) + 1, int(x) + 1])] += 1
        affinities.append(sum(math.sqrt(reference[b] * counts[b] / len(points)) for b in counts))
    return 1.0 - float(np.mean(affinities))


def test_the_histogram_likelihood_is_that_of_its_definition(histogram):
    rng = np.random.default_rng(5)
    bins = bins_of(two_coloured(100, 80, 0.4))
    states = rng.uniform([-20, -20, -3, -0.5], [220, 170, 3, 0.5], (80, 4))
    expected = [-20.0 * slow_squared_distance(histogram, state, bins) for state in states]
    np.testing.assert_allclose(histogram.log_likelihood(transforms(states), bins), expected, atol=1e-9)
    with use_numpy():
        np.testing.assert_allclose(histogram.log_likelihood(transforms(states), bins), expected, atol=1e-9)


def test_what_was_learnt_has_no_distance_and_its_halves_tell_how_it_is_turned(histogram):
    bins = bins_of(two_coloured(90, 70))
    states = np.array([[90, 70, 0, 0], [90, 70, math.pi, 0], [90, 70, 0.1, 0], [30, 20, 0, 0]])
    own, turned_over, nearly, elsewhere = histogram.squared_distance(transforms(states), bins)
    assert own == pytest.approx(0.0, abs=1e-9)
    assert nearly < 0.1 < 0.8 < turned_over
    assert elsewhere > 0.9
    moved = bins_of(two_coloured(120, 60, 0.5))
    assert histogram.squared_distance(transforms(np.array([[120, 60, 0.5, 0.0]])), moved)[0] < 0.05


def test_histograms_cost_the_same_for_objects_of_any_size():
    counts = []
    for side in (20, 200, 800):
        image = np.full((1000, 1000, 3), 90, np.uint8)
        placing = transforms(np.array([[500.0, 500.0, 0.0, 0.0]]))[0]
        learnt = HistogramLikelihood.learn(contour_from_box(side, side), bins_of(image), placing, 20.0)
        counts.append(len(learnt.points))
        np.testing.assert_allclose(learnt.references.sum(axis=1), 1.0)
    assert 90 < min(counts) <= max(counts) < 170


def test_colours_that_are_alike_share_a_bin_and_others_do_not():
    colours = np.array([[[20, 20, 230], [12, 10, 222], [20, 230, 20], [120, 120, 122], [126, 124, 124], [8, 8, 8]]])
    red, reddish, green, grey, greyish, black = hsv_bins().take(colour_indices(colours.astype(np.uint8)))[0]
    assert red == reddish and grey == greyish
    pale = hsv_bins().take(colour_indices(np.array([[[150, 150, 230]]], np.uint8))).item()
    assert len({red, pale, green, grey, black}) == 5
    assert max(red, green) < 100 <= min(grey, black) < HSV_BINS
    assert hsv_bins().max() < HSV_BINS


def textured(x: float, y: float, light: float = 1.0) -> np.ndarray:
    """A grey frame with a patch of texture about (x, y) on other texture."""
    rng = np.random.default_rng(7)
    frame = cv2.GaussianBlur(rng.integers(60, 160, (150, 200)).astype(np.float32), (0, 0), 1.5)
    patch = cv2.GaussianBlur(rng.integers(0, 255, (48, 80)).astype(np.float32), (0, 0), 2.0)
    frame[int(y) - 24 : int(y) + 24, int(x) - 40 : int(x) + 40] = light * patch
    return frame.astype(np.uint8)


def test_implicit_motion_prefers_where_the_patch_went_in_any_light():
    motion = MotionLikelihood.around(contour_from_box(80, 48), 8.0)
    before = motion.patch(transforms(np.array([[90.0, 70.0, 0.0, 0.0]]))[0], textured(90, 70))
    after = textured(102, 75, light=0.7)
    shifts = np.array([[dx, dy] for dx in range(-20, 21, 4) for dy in range(-20, 21, 5)], dtype=float)
    states = np.concatenate([shifts + np.array([102.0, 75.0]), np.zeros((len(shifts), 2))], axis=1)
    log_likelihood = motion.log_likelihood(transforms(states), after, before)
    best = shifts[np.argmax(log_likelihood)]
    assert best.tolist() == [0.0, 0.0]
    assert log_likelihood.max() == pytest.approx(0.0, abs=0.05)
    assert np.median(log_likelihood) < -5.0
    assert (log_likelihood >= -16.0).all()


def test_more_observation_noise_flattens_histograms_and_motion(histogram):
    motion = MotionLikelihood.around(contour_from_box(80, 48), 8.0)
    assert histogram.with_noise(2.0).strength == 5.0
    assert motion.with_noise(2.0).strength == 2.0
