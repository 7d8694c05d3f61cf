"""What the tracker measures of a frame, at the working size."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pfviz.kernels import NO_BIN, EdgeMap, pad_edges, steepest
from pfviz.particles import FloatArray
from pfviz.vision.blob import BlobDetector, GridProposal
from pfviz.vision.colour import CODE_ZERO, ColourRatio, colour_indices, hsv_bins
from pfviz.vision.shapes import Contour
from pfviz.vision.video import Image

WORKING_WIDTH = 320
_SMALLEST_OBJECT = 24.0
_LARGEST_WIDTH = 960
_BLUR = 1.0
_HYSTERESIS = 0.4
_EDGE_SHARE = 0.5
_EDGE_THRESHOLDS = (60.0, 400.0)


@dataclass(frozen=True)
class FrameFeatures:
    """What the tracker sees of a frame.

    Attributes:
        edge_map: the edges, ready to be scanned.
        ratio: ``(h + 2, w + 2)``, the colour ratio as ``pfviz.vision.colour.encode`` writes it, with a
            neutral margin.
        proposal: where the blob detector would look.
        bins: ``(h + 2, w + 2)``, the bin of each pixel's colour in the histograms of ``pfviz.vision.colour.hsv_bins``,
            with a margin that belongs to none; None where no measurement needs it.
        grey: ``(h, w)``, the lightness; None where no measurement needs it.
    """

    edge_map: EdgeMap
    ratio: NDArray[np.uint8]
    proposal: GridProposal
    bins: NDArray[np.uint8] | None = None
    grey: NDArray[np.uint8] | None = None

    @property
    def edges(self) -> NDArray[np.uint8]:
        """``(h, w)``: 1 on edges."""
        margin = self.edge_map.margin
        return self.edge_map.padded[margin:-margin, margin:-margin]

    @property
    def nbytes(self) -> int:
        arrays = (self.edge_map.padded, self.ratio, self.proposal, self.bins, self.grey)
        return sum(array.nbytes for array in arrays if array is not None)


@dataclass(frozen=True)
class FeatureExtractor:
    """From a frame to its features.

    Attributes:
        working_scale: pixels of the working image per pixel of the frame.
        colours: of object and background.
        detector: of blobs of the object's colour.
        edge_threshold: Canny's upper threshold on the gradient; the lower one is 0.4 of it.
        reach: how far from an outline edges are sought, in pixels of the working image.
        histograms: whether the bins of colour histograms are wanted.
        motion: whether the lightness is wanted.
    """

    working_scale: float
    colours: ColourRatio
    detector: BlobDetector
    edge_threshold: float
    reach: int
    histograms: bool = False
    motion: bool = False

    def __call__(self, image: Image) -> FrameFeatures:
        working = working_image(image, self.working_scale)
        indices = colour_indices(working)
        ratio = self.colours.codes.take(indices)
        grey = np.asarray(cv2.cvtColor(working, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
        edges = find_edges(grey, ratio, self.edge_threshold)
        return FrameFeatures(
            pad_edges(edges, self.reach),
            _with_margin(ratio, CODE_ZERO),
            self.detector.detect(ratio),
            _with_margin(hsv_bins().take(indices), NO_BIN) if self.histograms else None,
            grey if self.motion else None,
        )


def _with_margin(image: NDArray[np.uint8], value: int) -> NDArray[np.uint8]:
    """``(h + 2, w + 2)``: the ``image (h, w)`` with a pixel of ``value`` on every side."""
    return np.asarray(cv2.copyMakeBorder(image, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=value), dtype=np.uint8)


def working_scale(size: tuple[int, int], object_size: float, width: int = WORKING_WIDTH) -> float:
    """About ``width`` pixels of width, or as many more as a small object needs to be 24 pixels across.

    It is one over a whole number, so that frames shrink fast and evenly.
    """
    scale = max(width / size[0], _SMALLEST_OBJECT / object_size)
    return 1.0 / max(1, round(1.0 / min(scale, max(_LARGEST_WIDTH, width) / size[0])))


def working_image(image: Image, scale: float) -> Image:
    """The BGR ``image`` at the working size."""
    if scale == 1.0:
        return image
    size = round(image.shape[1] * scale), round(image.shape[0] * scale)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def find_edges(grey: NDArray[np.uint8], ratio: NDArray[np.uint8], threshold: float) -> NDArray[np.uint8]:
    """``(h, w)``: 255 on Canny's edges of lightness and of the colour ratio, whichever is stronger."""
    dx, dy = steepest(*_gradients(grey, ratio))
    return np.asarray(cv2.Canny(dx, dy, _HYSTERESIS * threshold, threshold, L2gradient=True), dtype=np.uint8)


def learn_edge_threshold(
    working: Image, ratio: NDArray[np.uint8], contour: Contour, start: FloatArray, scale: float
) -> float:
    """Half the typical gradient on the object's own outline: a weaker one is not an edge of it."""
    dx, dy = _gradients(np.asarray(cv2.cvtColor(working, cv2.COLOR_BGR2GRAY), dtype=np.uint8), ratio)
    magnitude = np.hypot(dx, dy).max(axis=2).astype(np.float32)
    magnitude = cv2.dilate(magnitude, np.ones((3, 3), np.uint8))
    at = (contour.outlines(start, factor=scale)[0] - 0.5).astype(np.float32)
    on_outline = cv2.remap(magnitude, at[None, :, 0], at[None, :, 1], cv2.INTER_LINEAR)
    return float(np.clip(_EDGE_SHARE * np.median(on_outline), *_EDGE_THRESHOLDS))


def _gradients(grey: NDArray[np.uint8], ratio: NDArray[np.uint8]) -> tuple[NDArray[np.int16], NDArray[np.int16]]:
    """``(h, w, 2)`` each: the horizontal and vertical derivatives of blurred lightness and colour ratio."""
    channels = cv2.GaussianBlur(cv2.merge([grey, ratio]), (0, 0), _BLUR)
    dx = cv2.Sobel(channels, cv2.CV_16S, 1, 0)
    dy = cv2.Sobel(channels, cv2.CV_16S, 0, 1)
    return np.asarray(dx, dtype=np.int16), np.asarray(dy, dtype=np.int16)
