"""What a file may cost before it is refused, and its name made fit to be shown. Files are hostile until decoded."""

from __future__ import annotations

import os
from dataclasses import dataclass, fields

_LONGEST_NAME = 240


@dataclass(frozen=True, slots=True)
class Limits:
    """What a video or an image may cost.

    Attributes:
        max_bytes: of each file.
        max_pixels: of each frame; of images it is checked before anything is decoded.
        max_frames: how many frames are used; there the video ends.
        patience: seconds that the decoder may take without a sign of progress.
        max_memory: bytes of address space of the decoder, where the system can limit it.

    Raises:
        ValueError: if one of them is not positive.
    """

    max_bytes: int = 8_000_000_000
    max_pixels: int = 50_000_000
    max_frames: int = 1_000_000
    patience: float = 20.0
    max_memory: int = 3_000_000_000

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not value > 0:
                raise ValueError(f"{field.name} must be positive, got {value!r}")


def display_name(name: str | os.PathLike[str]) -> str:
    """``name`` as one harmless line: what cannot be printed is escaped, what is overlong loses its middle.

    Escaped are control characters, line ends, marks of direction, and bytes that are not UTF-8. It is plain
    text: a page still has to escape it as such.
    """
    shown = "".join(character if character.isprintable() else _escaped(character) for character in os.fspath(name))
    if len(shown) > _LONGEST_NAME:
        half = _LONGEST_NAME // 2
        shown = f"{shown[:half]}…{shown[1 - half :]}"
    return shown


def _escaped(character: str) -> str:
    code = ord(character)
    if 0xDC80 <= code <= 0xDCFF:  # how Python keeps a byte of a file name that is not UTF-8
        return f"\\x{code - 0xDC00:02x}"
    return character.encode("unicode_escape", "surrogatepass").decode("ascii")
