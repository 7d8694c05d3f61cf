"""The blob detector's proposal: a density that is exactly what is drawn from, with its peak on the object."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.stats import chisquare, kstest

from pfviz.model import Proposal
from pfviz.vision.blob import BlobDetector, GridProposal
from pfviz.vision.colour import encode
from pfviz.vision.shapes import contour_from_polygon, signed_area

SIZE = (240, 180)
TRIANGLE = 1.4 * np.array([[-20.0, -12.0], [24.0, -4.0], [-6.0, 22.0]])

grids = arrays(float, st.tuples(st.integers(1, 12), st.integers(1, 12)), elements=st.floats(0.0, 1.0)).filter(
    lambda grid: grid.sum() > 1e-3
)


def ratio_with(*centres: tuple[float, float]) -> np.ndarray:
    """The coded colour ratio of a frame with a triangle of the object's colour about each of ``centres``."""
    picture = np.full((SIZE[1], SIZE[0]), -2.0)
    for centre in centres:
        cv2.fillPoly(picture, [np.rint(TRIANGLE + centre).astype(np.int32)], 2.0)
    return encode(picture)


@pytest.fixture(scope="module")
def detector() -> BlobDetector:
    contour, centre = contour_from_polygon(TRIANGLE + np.array([120.0, 90.0]))
    return BlobDetector.learn(ratio_with((120.0, 90.0)), contour, centre, 1.0, SIZE)


@given(grids, st.tuples(st.integers(1, 500), st.integers(1, 500)))
def test_the_density_integrates_to_one(grid, size):
    proposal = GridProposal(grid, size)
    rows, columns = grid.shape
    x, y = np.meshgrid((np.arange(columns) + 0.5) / columns * size[0], (np.arange(rows) + 0.5) / rows * size[1])
    middles = np.stack([x.ravel(), y.ravel()], axis=1)
    cell_area = size[0] / columns * size[1] / rows
    assert np.exp(proposal.log_density(middles)).sum() * cell_area == pytest.approx(1.0)


@given(grids)
def test_there_is_nothing_outside_the_frame(grid):
    proposal = GridProposal(grid, (100, 50))
    outside = np.array([[-1e-9, 10.0], [100.0, 10.0], [10.0, -3.0], [10.0, 50.0], [1e6, 1e6]])
    assert (proposal.log_density(outside) == -np.inf).all()


@settings(max_examples=20)
@given(grids, st.integers(0, 2**32))
def test_draws_lie_where_the_density_is_positive(grid, seed):
    proposal = GridProposal(grid, (100, 50))
    assert np.isfinite(proposal.log_density(proposal.sample(np.random.default_rng(seed), 200))).all()


def test_draws_follow_the_density():
    rng = np.random.default_rng(0)
    proposal = GridProposal(rng.gamma(0.5, size=(9, 12)) + 0.02, (120, 45))
    draws = proposal.sample(rng, 40_000)
    counts, *_ = np.histogram2d(draws[:, 1], draws[:, 0], bins=(9, 12), range=((0, 45), (0, 120)))
    middles = np.stack(np.meshgrid(np.arange(12) * 10 + 5.0, np.arange(9) * 5 + 2.5), axis=-1).reshape(-1, 2)
    expected = 40_000 * 50 * np.exp(proposal.log_density(middles)).reshape(9, 12)
    assert chisquare(counts.ravel(), expected.ravel()).pvalue > 1e-4
    for axis, cell in ((0, 10.0), (1, 5.0)):
        assert kstest(np.mod(draws[:, axis], cell) / cell, "uniform").pvalue > 1e-4


def test_it_is_a_proposal_of_x_and_y(detector):
    proposal = detector.detect(ratio_with((60.0, 60.0)))
    assert isinstance(proposal, Proposal)
    assert proposal.components == (0, 1)


@pytest.mark.parametrize(
    ("size", "scale", "columns"),
    [((240, 180), 3.5, 24), ((240, 180), 1.0, 65), ((1920, 1440), 0.5, 160), ((60, 45), 0.3, 30)],
)
def test_the_grid_is_that_of_the_sources_or_as_much_finer_as_the_object_is_smaller(size, scale, columns):
    contour, centre = contour_from_polygon(scale * TRIANGLE + np.array(size) / 2)
    detector = BlobDetector.learn(np.full(size[::-1], 8, np.uint8), contour, centre, 1.0, size)
    assert detector.shape == (pytest.approx(0.75 * columns, abs=1), pytest.approx(columns, abs=2))


@pytest.mark.parametrize("centre", [(60, 60), (31, 140), (205, 43), (117, 95)])
def test_the_peak_is_at_the_centre_of_the_object(detector, centre):
    probabilities = detector.detect(ratio_with(centre)).probabilities
    row, column = np.unravel_index(np.argmax(probabilities), probabilities.shape)
    cell = SIZE[0] / probabilities.shape[1]
    assert np.hypot((column + 0.5) * cell - centre[0], (row + 0.5) * cell - centre[1]) < 4.0


@pytest.mark.parametrize("centre", [(60, 60), (31, 140), (205, 43), (117, 95)])
def test_most_draws_are_near_the_centre_of_the_object_and_some_all_about_it(detector, centre):
    draws = detector.detect(ratio_with(centre)).sample(np.random.default_rng(1), 4000)
    away = np.hypot(*(draws - centre).T) / np.sqrt(abs(signed_area(TRIANGLE)))
    assert (away < 0.25).mean() > 0.5
    assert 0.1 < ((away > 0.25) & (away < 1.0)).mean() < 0.45


def test_sharpening_moves_no_mass_from_peak_to_peak(detector):
    """A weaker peak keeps what a power of the response gives it."""
    halved = np.where(ratio_with((180.0, 120.0)) > 128, 160, ratio_with((60.0, 60.0))).astype(np.uint8)
    shares = []
    for sharp_share in (0.0, 0.9):
        draws = replace(detector, sharp_share=sharp_share).detect(halved).sample(np.random.default_rng(0), 20_000)
        one, other = ((np.hypot(*(draws - at).T) < 20.0).sum() for at in ([60, 60], [180, 120]))
        shares.append(other / (one + other))
    assert 0.02 < shares[0] < 0.4
    assert shares[1] == pytest.approx(shares[0], rel=0.25)


def test_draws_crowd_at_the_centre_as_those_of_a_flat_mask_would_not(detector):
    draws = detector.detect(ratio_with((60.0, 60.0))).sample(np.random.default_rng(0), 1000)
    flat_mask = np.pi * 12.0**2 / signed_area(TRIANGLE)
    assert (np.hypot(*(draws - 60.0).T) < 12.0).mean() > 1.5 * flat_mask


def test_two_of_a_kind_share_the_draws(detector):
    draws = detector.detect(ratio_with((60.0, 60.0), (180.0, 120.0))).sample(np.random.default_rng(0), 4000)
    one, other = ((np.hypot(*(draws - at).T) < 20.0).mean() for at in ([60, 60], [180, 120]))
    assert one == pytest.approx(other, abs=0.12)
    assert one + other > 0.8


def test_without_the_object_the_proposal_is_flat(detector):
    probabilities = detector.detect(ratio_with()).probabilities
    np.testing.assert_allclose(probabilities, 1.0 / probabilities.size, rtol=0.05)


def test_it_is_positive_everywhere_in_the_frame(detector):
    proposal = detector.detect(ratio_with((60.0, 60.0)))
    x, y = np.meshgrid(np.linspace(0, 239.99, 100), np.linspace(0, 179.99, 100))
    assert np.isfinite(proposal.log_density(np.stack([x.ravel(), y.ravel()], axis=1))).all()


def test_a_gate_keeps_its_share_for_what_lies_within_it_and_the_rest_for_everything(detector):
    plain = detector.detect(ratio_with((60.0, 60.0), (180.0, 120.0)))
    gated = plain.gated(np.array([62.0, 58.0]), 15.0, 0.6)
    rows, columns = plain.probabilities.shape
    x, y = np.meshgrid((np.arange(columns) + 0.5) * plain.cell[0], (np.arange(rows) + 0.5) * plain.cell[1])
    window = np.exp(-0.5 * ((x - 62.0) ** 2 + (y - 58.0) ** 2) / 15.0**2) * plain.probabilities
    np.testing.assert_allclose(gated.probabilities, 0.4 * plain.probabilities + 0.6 * window / window.sum())
    assert (gated.probabilities >= 0.4 * plain.probabilities - 1e-15).all()
    draws = gated.sample(np.random.default_rng(0), 4000)
    one, other = ((np.hypot(*(draws - at).T) < 20.0).mean() for at in ([60, 60], [180, 120]))
    assert one > 3.0 * other > 0.3


def test_a_gate_on_nothing_is_left_open():
    proposal = GridProposal(np.eye(4), (400, 400))
    assert proposal.gated(np.array([5000.0, 5000.0]), 10.0, 0.6) is proposal


@pytest.mark.parametrize("floor", [0.0, 0.1])
def test_a_less_sure_detector_is_flatter(detector, floor):
    ratio, detector = ratio_with((60.0, 60.0)), replace(detector, floor=floor)
    peaks = [detector.widened(factor).detect(ratio).probabilities.max() for factor in (0.7, 1.0, 1.5, 3.0)]
    assert (np.diff(peaks) < 0).all()


@pytest.mark.parametrize("grid", [np.zeros((2, 2)), np.full((2, 2), -1.0), np.full((2, 2), np.nan), np.ones(3)])
def test_what_is_not_a_density_is_refused(grid):
    with pytest.raises(ValueError, match="non-negative numbers, not all zero"):
        GridProposal(grid, (10, 10))
