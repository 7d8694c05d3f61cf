"""Files that were damaged, mislabelled or made to do harm, each written by a small function."""

from __future__ import annotations

import os
import struct
import wave
import zlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np

SIZE = (64, 48)


def numbered(index: int) -> np.ndarray:
    """A frame that shows its number in eight bright or dark blocks."""
    frame = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    for bit in range(8):
        frame[:, 8 * bit : 8 * bit + 8] = 230 if index >> bit & 1 else 20
    return frame


def number_in(frame: np.ndarray) -> int:
    return sum(int(frame[12:36, 8 * bit + 2 : 8 * bit + 6].mean() > 125) << bit for bit in range(8))


def write_video(path: Path, count: int, codec: str = "mp4v", size: tuple[int, int] = SIZE) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*codec), 25.0, size)
    for index in range(count):
        writer.write(cv2.resize(numbered(index), size, interpolation=cv2.INTER_NEAREST))
    writer.release()
    return path


def coded(index: int, suffix: str = ".png", size: tuple[int, int] = SIZE) -> bytes:
    """A numbered frame as an image file."""
    return cv2.imencode(suffix, cv2.resize(numbered(index), size, interpolation=cv2.INTER_NEAREST))[1].tobytes()


def write_images(folder: Path, count: int, suffix: str = ".png") -> Path:
    """``frame0.png``, ``frame1.png``, ...: numbers without leading zeros."""
    folder.mkdir()
    for index in range(count):
        (folder / f"frame{index}{suffix}").write_bytes(coded(index, suffix))
    return folder


def write_cut_video(path: Path, count: int = 100, keep: float = 0.5, codec: str = "MJPG") -> Path:
    """A video that stops in the middle."""
    whole = write_video(path, count, codec).read_bytes()
    path.write_bytes(whole[: int(keep * len(whole))])
    return path


def patched(data: bytes, *replacements: tuple[bytes, bytes]) -> bytes:
    for old, new in replacements:
        assert old in data
        data = data.replace(old, new)
    return data


def zero_length(path: Path) -> None:
    path.write_bytes(b"")


def text(path: Path) -> None:
    path.write_text("this is not a video\n" * 50)


def garbage(path: Path) -> None:
    path.write_bytes(np.random.default_rng(0).bytes(30_000))


def no_frames(path: Path) -> None:
    write_video(path, 0)


def only_the_beginning(path: Path) -> None:
    path.write_bytes(write_video(path, 30).read_bytes()[:1000])


def without_its_index(path: Path) -> None:
    """An MP4 whose end, where the index is, is missing."""
    path.write_bytes(write_video(path, 30).read_bytes()[:-200])


def zeros_for_pixels(path: Path) -> None:
    """An MP4 whose coded frames are all zeros."""
    data = bytearray(write_video(path, 30).read_bytes())
    begin = data.index(b"mdat") + 4
    end = data.index(b"moov") - 4
    data[begin:end] = bytes(end - begin)
    path.write_bytes(data)


def sound_as_wav(path: Path) -> None:
    with path.open("wb") as stream, wave.open(stream, "wb") as sound:
        sound.setparams((1, 2, 8000, 0, "NONE", ""))
        sound.writeframes(bytes(16_000))


def sound_as_mp4(path: Path) -> None:
    data = write_video(path, 5).read_bytes()
    path.write_bytes(patched(data, (b"vide", b"soun"), (b"vmhd", b"smhd"), (b"mp4v", b"mp4a")))


def huge_avi(path: Path) -> None:
    """Uncompressed frames of which the header says that they have 20,000 x 20,000 pixels."""
    small = write_video(path.with_name("small.avi"), 5, "I420")
    old, new = struct.pack("<ii", *SIZE), struct.pack("<ii", 20_000, 20_000)
    path.write_bytes(patched(small.read_bytes(), (old, new)))
    small.unlink()


def huge_png(path: Path) -> None:
    """65,535 x 65,535 pixels in a few kilobytes."""
    header = struct.pack(">IIBBBBB", 65_535, 65_535, 8, 2, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(bytes(1_000_000))), (b"IEND", b""))
    body = b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in chunks
    )
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + body)


def huge_jpeg(path: Path) -> None:
    old, new = struct.pack(">HH", SIZE[1], SIZE[0]), struct.pack(">HH", 65_500, 65_500)
    path.write_bytes(patched(coded(1, ".jpg"), (old, new)))


def huge_bmp(path: Path) -> None:
    path.write_bytes(patched(coded(1, ".bmp"), (struct.pack("<ii", *SIZE), struct.pack("<ii", 65_535, -65_535))))


def broken_png(path: Path) -> None:
    """The header and then nothing."""
    path.write_bytes(coded(1)[:40])


def playlist(path: Path) -> None:
    """A list that would have FFmpeg open another file."""
    write_video(path.with_name("secret.ts"), 30, "MPG1")
    path.write_text("#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nsecret.ts\n#EXT-X-ENDLIST\n")


def concatenation(path: Path) -> None:
    """Another list that would have FFmpeg open another file."""
    write_video(path.with_name("secret.mp4"), 30)
    path.write_text("ffconcat version 1.0\nfile secret.mp4\n")


BAD_FILES: dict[str, Callable[[Path], None]] = {
    "zero-length.mp4": zero_length,
    "text.mp4": text,
    "garbage.mkv": garbage,
    "no-frames.mp4": no_frames,
    "only-the-beginning.mp4": only_the_beginning,
    "without-its-index.mp4": without_its_index,
    "zeros-for-pixels.mp4": zeros_for_pixels,
    "sound.wav": sound_as_wav,
    "sound.mp4": sound_as_mp4,
    "huge.avi": huge_avi,
    "huge.png": huge_png,
    "huge.jpg": huge_jpeg,
    "huge.bmp": huge_bmp,
    "huge-image.mp4": huge_png,
    "broken.png": broken_png,
    "playlist.m3u8": playlist,
    "concatenation.mp4": concatenation,
}
"""Files none of which gives a single frame, under the names they have."""


def children() -> set[int]:
    """The processes that this one has started and not yet buried (Linux)."""
    tasks = Path("/proc/self/task").iterdir()
    found: set[int] = set()
    for task in tasks:
        with suppress(OSError):  # a thread that has ended meanwhile
            found |= {int(pid) for pid in (task / "children").read_text().split()}
    return found


def open_files() -> set[str]:
    """The names of this process's open file descriptors (Linux)."""
    return set(os.listdir("/proc/self/fd"))
