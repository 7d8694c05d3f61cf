"""Colour models: Gaussians against scipy, and ratios of colours that are plain to see."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from pfviz.vision.colour import ColourRatio, GaussianColours, colour_indices, decode, encode

RED, GREY, BLUE = (40, 40, 200), (128, 128, 128), (200, 60, 30)


def picture(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A red square on grey, with noise, and where it is."""
    image = np.full((60, 80, 3), GREY, float)
    inside = np.zeros((60, 80), bool)
    inside[20:40, 30:50] = True
    image[inside] = RED
    return np.clip(image + rng.normal(0, 5, image.shape), 0, 255).astype(np.uint8), inside


def test_the_density_is_that_of_the_mixture():
    rng = np.random.default_rng(0)
    covariances = np.array([np.diag([30.0, 20.0, 10.0]), [[40.0, 5.0, 0.0], [5.0, 30.0, 2.0], [0.0, 2.0, 20.0]]])
    means, weights = np.array([[100.0, 120.0, 130.0], [50.0, 140.0, 110.0]]), np.array([0.3, 0.7])
    colours = rng.uniform(0, 255, (200, 3))
    expected = sum(
        w * multivariate_normal(m, c).pdf(colours) for w, m, c in zip(weights, means, covariances, strict=True)
    )
    np.testing.assert_allclose(GaussianColours(means, covariances, weights).density(colours), expected)


def test_clusters_are_told_apart():
    rng = np.random.default_rng(1)
    centres = np.array([[40.0, 128.0, 128.0], [200.0, 100.0, 150.0], [120.0, 180.0, 90.0]])
    colours = np.concatenate([rng.normal(c, 3.0, (n, 3)) for c, n in zip(centres, (100, 200, 300), strict=True)])
    fitted = GaussianColours.fit(colours, 3)
    order = np.argsort(fitted.weights)
    np.testing.assert_allclose(fitted.means[order], centres, atol=1.5)
    np.testing.assert_allclose(fitted.weights[order], [1 / 6, 2 / 6, 3 / 6])


def test_one_single_colour_can_be_learnt():
    fitted = GaussianColours.fit(np.full((50, 3), 90.0), 3)
    assert np.isfinite(fitted.density(np.array([[90.0, 90.0, 90.0]]))).all()


def test_the_object_stands_out_and_unseen_colours_count_as_background():
    image, inside = picture(np.random.default_rng(2))
    ratio = ColourRatio.learn(image, inside, ~inside)
    values = decode(ratio.of(image))
    assert values[inside].min() > 1.0
    assert values[~inside].max() < -1.0
    assert decode(ratio.of(np.full((1, 1, 3), BLUE, np.uint8)))[0, 0] < -1.0


def test_a_little_less_light_changes_nothing():
    image, inside = picture(np.random.default_rng(3))
    ratio = ColourRatio.learn(image, inside, ~inside)
    darker = (image * 0.9).astype(np.uint8)
    assert decode(ratio.of(darker))[inside].mean() > 1.0


def test_codes_come_back_as_they_went_and_are_cut_off():
    values = np.linspace(-2, 2, 41)
    np.testing.assert_allclose(decode(encode(values)), values, atol=0.5 / 60)
    assert decode(encode(np.array([-9.0, 0.0, 9.0]))) == pytest.approx([-2.0, 0.0, 2.0])


def test_colours_are_indexed_by_five_bits_of_each_channel():
    image = np.random.default_rng(0).integers(0, 256, (9, 7, 3)).astype(np.uint8)
    blue, green, red = (image.astype(int) // 8).transpose(2, 0, 1)
    np.testing.assert_array_equal(colour_indices(image), 1024 * blue + 32 * green + red)
    np.testing.assert_array_equal(colour_indices(image[:, ::2]), colour_indices(image)[:, ::2])
