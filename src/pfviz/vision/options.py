"""What a tracker assumes before it has seen anything."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class TrackerOptions:
    """What a tracker assumes before it has seen anything. Lengths are relative, so that it works for any
    video.

    Attributes:
        working_width: about how many pixels wide the image is that is measured; more where the object is small. Frames
            that are smaller are measured as they are.
        normals: points of the outline that are measured.
        independent_normals: how many of them count as independent; tempers the contour likelihood.
        independent_pixels: how many of the pixels inside and outside count as independent; tempers the colour
            one.
        histogram_strength: the lambda of ``exp(-lambda D^2)`` (Pérez et al. 2002 take 20).
        motion_strength: the lambda of ``exp(-lambda (1 - correlation))``.
        position_noise: standard deviation of the position's noise at 30 frames per second, relative to the
            geometric mean of the object's size and the frame's diagonal.
        rotation_noise: the same of rotation, in radians.
        scale_noise: the same of the logarithm of scale.
        stretch_noise: the same of the stretch, in the affine shape space.
        keep: the part of the velocities of x, y, rotation and log scale kept after 1/30 second.
        scale_spring: the part of the log scale drawn back towards zero in 1/30 second.
        stretch_keep: the part of the stretch's velocity kept after 1/30 second.
        stretch_spring: the part of the stretch drawn back towards zero in 1/30 second.
    """

    working_width: int = 320
    normals: int = 32
    independent_normals: float = 16.0
    independent_pixels: float = 4.0
    histogram_strength: float = 20.0
    motion_strength: float = 8.0
    position_noise: float = 0.02
    rotation_noise: float = 0.04
    scale_noise: float = 0.008
    stretch_noise: float = 0.015
    keep: tuple[float, float, float, float] = (0.9, 0.9, 0.8, 0.7)
    scale_spring: float = 0.002
    stretch_keep: float = 0.7
    stretch_spring: float = 0.02
