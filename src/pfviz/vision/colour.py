"""Colour models of an object and of what is behind it, compared pixel by pixel."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from pfviz.particles import FloatArray
from pfviz.vision.video import Image

_BITS = 5
_LEVELS = 1 << _BITS
_SPREAD = (10.0, 5.0, 5.0)
CODE_ZERO, CODE_STEPS = 128, 60.0
MOST = 2.0
_OBJECT_GAUSSIANS, _BACKGROUND_GAUSSIANS = 3, 5
_SIDE, _LEAST_SATURATION, _LEAST_VALUE = 10, 0.1, 0.2
HSV_BINS = _SIDE * _SIDE + _SIDE
_UNSEEN_OBJECT, _UNSEEN_BACKGROUND = 0.02, 0.1


def encode(log_ratio: FloatArray) -> NDArray[np.uint8]:
    """Log-ratios as bytes, in steps of 1/60 about 128, cut off at +-2.

    So no pixel says more than 7 to 1: what counts is that a region is of the object's colours, not how very
    much of them.
    """
    return np.rint(np.clip(log_ratio, -MOST, MOST) * CODE_STEPS + CODE_ZERO).astype(np.uint8)


def decode(codes: NDArray[np.uint8]) -> FloatArray:
    """The log-ratios that ``encode`` wrote."""
    return (codes.astype(float) - CODE_ZERO) / CODE_STEPS


@dataclass(frozen=True, slots=True)
class GaussianColours:
    """A mixture of Gaussians in CIE L*a*b* (each channel 0 to 255).

    Attributes:
        means: ``(g, 3)``.
        covariances: ``(g, 3, 3)``.
        weights: ``(g,)``, summing to one.
    """

    means: FloatArray
    covariances: FloatArray
    weights: FloatArray

    @classmethod
    def fit(cls, colours: FloatArray, gaussians: int) -> GaussianColours:
        """The mixture that describes ``colours (n, 3)``, by splitting the widest cluster again and again.

        Every covariance is widened by the changes that light and noise make to a colour, so that a single
        colour can be learnt and is recognised in another light.
        """
        clusters = [colours]
        while len(clusters) < gaussians:
            spreads = [len(c) * _largest_variance(c)[0] for c in clusters]
            widest = int(np.argmax(spreads))
            axis = _largest_variance(clusters[widest])[1]
            along = (clusters[widest] - clusters[widest].mean(axis=0)) @ axis
            halves = clusters[widest][along <= 0], clusters[widest][along > 0]
            if min(len(half) for half in halves) < 4:
                break
            clusters[widest : widest + 1] = halves
        means = np.array([c.mean(axis=0) for c in clusters])
        covariances = np.array([_covariance(c) + np.diag(np.square(_SPREAD)) for c in clusters])
        weights = np.array([len(c) for c in clusters], dtype=float)
        return cls(means, covariances, weights / weights.sum())

    def density(self, colours: FloatArray) -> FloatArray:
        """``(n,)``: the density at ``colours (n, 3)``."""
        total = np.zeros(len(colours))
        for mean, covariance, weight in zip(self.means, self.covariances, self.weights, strict=True):
            deviations = colours - mean
            squares = np.einsum("ni,ij,nj->n", deviations, np.linalg.inv(covariance), deviations)
            total += weight * np.exp(-0.5 * squares) / np.sqrt((2 * np.pi) ** 3 * np.linalg.det(covariance))
        return total


def _covariance(colours: FloatArray) -> FloatArray:
    return np.cov(colours.T, bias=True) if len(colours) > 1 else np.zeros((3, 3))


def _largest_variance(colours: FloatArray) -> tuple[float, FloatArray]:
    values, vectors = np.linalg.eigh(_covariance(colours))
    return float(values[-1]), vectors[:, -1]


@dataclass(frozen=True, slots=True)
class ColourRatio:
    """log p(colour | object) - log p(colour | background) for every colour, as a table.

    Attributes:
        codes: ``(32768,)``, indexed by the five leading bits of blue, green and red; see ``encode``.
    """

    codes: NDArray[np.uint8]

    @classmethod
    def learn(cls, image: Image, inside: NDArray[np.bool_], near: NDArray[np.bool_]) -> ColourRatio:
        """From the BGR ``image``, the object's pixels ``inside`` and the pixels ``near`` it but not of it.

        The background is described by two mixtures of equal weight, one of what is near, which matters most,
        and one of the whole rest. A colour that was never seen counts rather as background.
        """
        lab = cv2.cvtColor(image, cv2.COLOR_BGR2LAB).astype(float)
        everything_else = ~inside
        codes = _all_colours()
        volume = 256.0**3
        background = 0.5 * (
            _fitted(lab[near if near.sum() >= 8 else everything_else], _BACKGROUND_GAUSSIANS).density(codes)
            + _fitted(lab[everything_else], _BACKGROUND_GAUSSIANS).density(codes)
        )
        own = _fitted(lab[inside], _OBJECT_GAUSSIANS).density(codes)
        ratio = np.log((1 - _UNSEEN_OBJECT) * own + _UNSEEN_OBJECT / volume)
        ratio -= np.log((1 - _UNSEEN_BACKGROUND) * background + _UNSEEN_BACKGROUND / volume)
        return cls(encode(ratio))

    def of(self, image: Image) -> NDArray[np.uint8]:
        """``(h, w)``: the log-ratio at every pixel of the BGR ``image``, as ``encode`` writes it."""
        return self.codes.take(colour_indices(image))


def _fitted(colours: FloatArray, gaussians: int, limit: int = 4000) -> GaussianColours:
    stride = max(1, len(colours) // limit)
    return GaussianColours.fit(colours[::stride], gaussians)


def colour_indices(image: Image) -> NDArray[np.uint16]:
    """``(h, w)``: five bits of each channel, side by side, blue first: where to look in a table of colours."""
    return cv2.cvtColor(image, cv2.COLOR_RGB2BGR555).view(np.uint16)[..., 0]


def _all_colours() -> FloatArray:
    """``(32768, 3)``: the L*a*b* value in the middle of each cell of the table."""
    return cv2.cvtColor(_table_levels(), cv2.COLOR_BGR2LAB)[0].astype(float)


def _table_levels() -> Image:
    """``(1, 32768, 3)``: the BGR colour in the middle of each cell of the table."""
    levels = ((np.arange(_LEVELS) + 0.5) * (256 / _LEVELS)).astype(np.uint8)
    blue, green, red = np.meshgrid(levels, levels, levels, indexing="ij")
    return np.stack([blue, green, red], axis=-1).reshape(1, -1, 3)


@lru_cache(maxsize=1)
def hsv_bins() -> NDArray[np.uint8]:
    """``(32768,)``: for every colour of the table its bin among ``HSV_BINS``, as Pérez et al. (2002) bin colours.

    Hue and saturation in 10 x 10 bins where there is enough of both saturation and value to know the hue; 10 bins of
    value for the rest, which is nearly grey or dark.
    """
    levels = _table_levels()
    hsv = cv2.cvtColor(levels, cv2.COLOR_BGR2HSV_FULL)[0].astype(float) / 256.0
    hue, saturation, value = np.minimum((hsv * _SIDE).astype(int), _SIDE - 1).T
    coloured = (hsv[:, 1] > _LEAST_SATURATION) & (hsv[:, 2] > _LEAST_VALUE)
    return np.where(coloured, hue * _SIDE + saturation, _SIDE * _SIDE + value).astype(np.uint8)
