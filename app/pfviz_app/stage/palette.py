"""Colours with a meaning, the same everywhere (from the colour-blind-safe set of Okabe and Ito)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Rgb = tuple[int, int, int]
Colours = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Palette:
    """One set of colours on one background.

    Attributes:
        background: of the canvas.
        ink: axes and text.
        faint: what is only there to guide the eye.
        history: histories and particles before the step.
        proposal: innovations and the density they are drawn from.
        likelihood: what was observed, and how well it explains an innovation.
        posterior: the new particles and the estimate.
        exact: the exact posterior.
        truth: the truth.
        chosen: what the visitor has clicked.
        rival: the posterior and the estimate of the filter that is compared with.
    """

    background: Rgb
    ink: Rgb
    faint: Rgb
    history: Rgb
    proposal: Rgb
    likelihood: Rgb
    posterior: Rgb
    exact: Rgb
    truth: Rgb
    chosen: Rgb
    rival: Rgb

    def of_rival(self) -> Palette:
        """The same for the filter that is compared with."""
        return replace(self, posterior=self.rival)


LIGHT = Palette(
    background=(255, 255, 255),
    ink=(40, 44, 52),
    faint=(205, 210, 216),
    history=(0, 114, 178),
    proposal=(230, 140, 0),
    likelihood=(120, 110, 20),
    posterior=(0, 158, 115),
    exact=(0, 0, 0),
    truth=(213, 62, 0),
    chosen=(200, 40, 110),
    rival=(128, 60, 190),
)
DARK = Palette(
    background=(20, 21, 23),
    ink=(222, 226, 230),
    faint=(66, 70, 76),
    history=(86, 180, 233),
    proposal=(240, 170, 30),
    likelihood=(240, 228, 66),
    posterior=(30, 200, 150),
    exact=(255, 255, 255),
    truth=(255, 110, 50),
    chosen=(255, 120, 180),
    rival=(190, 140, 255),
)


def blend(background: Rgb, colour: Rgb, strength: NDArray[np.float64] | float) -> Colours:
    """``colour`` mixed into ``background``; a strength of 1 is the colour, 0 the background.

    Returns:
        ``(n, 3)`` for n strengths, ``(3,)`` for one.
    """
    share = np.minimum(np.maximum(np.asarray(strength, dtype=float), 0.0), 1.0)[..., None]
    start = np.array(background, dtype=float)
    return np.rint(start + share * (np.array(colour) - start)).astype(np.uint8)
