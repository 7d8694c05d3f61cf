"""Learning the outline of an object from one frame and the box around it."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pfviz.vision.video import Box, Image

Mask = NDArray[np.uint8]

_MARGIN = 0.5
_ROUNDS = 5
_CORE = 0.4
_AREA = (0.3, 0.97)
_REACH = 0.75
_SOLIDITY = 0.75


def box_error(box: Box, size: tuple[int, int]) -> str | None:
    """What is wrong with ``box`` in a frame of ``size`` (width, height), in one line; None if nothing is."""
    x, y, w, h = box
    text = f"box {x:g},{y:g},{w:g},{h:g}"
    frame = f"the frame of {size[0]} x {size[1]} pixels"
    if not np.isfinite(box).all():
        return f"{text}: expected four finite numbers x,y,width,height"
    if w <= 0 or h <= 0:
        return f"{text}: width and height must be positive (in {frame})"
    if w < 4 or h < 4:
        return f"{text}: too small to hold an object, at least 4 x 4 pixels are needed (in {frame})"
    if not (0 <= x + w / 2 <= size[0] and 0 <= y + h / 2 <= size[1]):
        return f"{text}: its centre lies outside {frame}"
    if w > 1.5 * size[0] or h > 1.5 * size[1]:
        return f"{text}: larger than {frame}"
    return None


def segment(image: Image, box: Box) -> Mask | None:
    """``(height, width)``: 1 on the object that ``box`` encloses in the BGR ``image``, or None if that is
    unclear.

    GrabCut in the box and a margin about it, cleaned of holes and specks. The answer is believed only if it
    looks like the object of a tight box: it fills a fair part of the box, reaches near all its sides, and is
    compact.
    """
    height, width = image.shape[:2]
    left, top, right, bottom = _clipped(_grown(box, _MARGIN), (width, height))
    crop = np.ascontiguousarray(image[top:bottom, left:right])
    inner = (box[0] - left, box[1] - top, box[2], box[3])
    found = _clean(_grab_cut(crop, inner))
    if not _plausible(found, inner):
        return None
    mask = np.zeros((height, width), np.uint8)
    mask[top:bottom, left:right] = found
    return mask


def _grown(box: Box, margin: float) -> Box:
    x, y, w, h = box
    return x - margin * w, y - margin * h, (1 + 2 * margin) * w, (1 + 2 * margin) * h


def _clipped(box: Box, size: tuple[int, int]) -> tuple[int, int, int, int]:
    """Left, top, right, bottom of the pixels of ``box`` that lie in an image of ``size``."""
    x, y, w, h = box
    left, top = max(0, int(np.floor(x))), max(0, int(np.floor(y)))
    return left, top, min(size[0], int(np.ceil(x + w))), min(size[1], int(np.ceil(y + h)))


def _grab_cut(crop: Image, box: Box) -> Mask:
    """``(h, w)``: 1 where GrabCut finds the object; its core is sure, all outside the box is background."""
    size = (crop.shape[1], crop.shape[0])
    labels = np.full(crop.shape[:2], cv2.GC_BGD, np.uint8)
    left, top, right, bottom = _clipped(box, size)
    labels[top:bottom, left:right] = cv2.GC_PR_BGD
    x, y, w, h = box
    centre = (round(x + w / 2), round(y + h / 2))
    within = np.zeros_like(labels)
    cv2.ellipse(within, centre, (max(1, round(w / 2)), max(1, round(h / 2))), 0, 0, 360, 1, -1)
    labels[(within == 1) & (labels == cv2.GC_PR_BGD)] = cv2.GC_PR_FGD
    core = (max(1, round(_CORE * w / 2)), max(1, round(_CORE * h / 2)))
    cv2.ellipse(labels, centre, core, 0, 0, 360, cv2.GC_FGD, -1)
    if (labels == cv2.GC_BGD).sum() < 16:
        return (labels != cv2.GC_BGD).astype(np.uint8)
    cv2.setRNGSeed(0)
    background, foreground = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.grabCut(crop, labels, (0, 0, 1, 1), background, foreground, _ROUNDS, cv2.GC_INIT_WITH_MASK)
    return ((labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD)).astype(np.uint8)


def _clean(mask: Mask) -> Mask:
    """The largest part of ``mask``, with its holes filled and thin growths cut off."""
    radius = max(1, round(0.06 * np.sqrt(max(1, mask.sum()))))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    padded = cv2.copyMakeBorder(mask, radius, radius, radius, radius, cv2.BORDER_REPLICATE)
    opened = cv2.morphologyEx(cv2.morphologyEx(padded, cv2.MORPH_CLOSE, disc), cv2.MORPH_OPEN, disc)
    opened = np.ascontiguousarray(opened[radius:-radius, radius:-radius])
    found, _ = cv2.findContours(opened, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    cleaned = np.zeros_like(mask)
    if found:
        cv2.drawContours(cleaned, [max(found, key=cv2.contourArea)], 0, 1, -1)
    return cleaned


def _plausible(mask: Mask, box: Box) -> bool:
    area = float(mask.sum())
    if not _AREA[0] <= area / (box[2] * box[3]) <= _AREA[1]:
        return False
    points = cv2.findNonZero(mask)
    _, _, w, h = cv2.boundingRect(points)
    hull = cv2.contourArea(cv2.convexHull(points)) + 1.0
    return w >= _REACH * box[2] and h >= _REACH * box[3] and area / hull >= _SOLIDITY
