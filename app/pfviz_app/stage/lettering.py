"""Text as small transparent pictures, since viser's own labels are always dark on a light box."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import matplotlib
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from pfviz_app.stage.palette import Rgb

_FONTS = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
_DENSITY = 2


@lru_cache(maxsize=16)
def _font(size: float, bold: bool) -> ImageFont.FreeTypeFont:
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(_FONTS / name), size * _DENSITY)


def lettered(text: str, size: float, colour: Rgb, bold: bool = False) -> tuple[NDArray[np.uint8], float, float]:
    """``text`` as a BGRA picture.

    Args:
        text: one line.
        size: of the letters, in pixels.
        colour: of the letters.
        bold: whether they are.

    Returns:
        The picture, at twice the resolution, and its width and height in pixels.
    """
    font = _font(size, bold)
    left, _, right, _ = font.getbbox(text)
    ascent, descent = font.getmetrics()
    width, height = int(right - left) + 4, ascent + descent + 2
    mask = Image.new("L", (width, height), 0)
    ImageDraw.Draw(mask).text((2 - left, 1), text, font=font, fill=255)
    picture = np.empty((height, width, 4), np.uint8)
    picture[..., :3] = colour[::-1]
    picture[..., 3] = np.asarray(mask)
    return picture, width / _DENSITY, height / _DENSITY


@lru_cache(maxsize=256)
def fitted(text: str, size: float, width: float, bold: bool = False) -> str:
    """``text``, cut with an ellipsis where it would be wider than ``width`` pixels."""
    font = _font(size, bold)
    if font.getlength(text) / _DENSITY <= width:
        return text
    while text and font.getlength(text + "…") / _DENSITY > width:
        text = text[:-1]
    return text.rstrip() + "…"
