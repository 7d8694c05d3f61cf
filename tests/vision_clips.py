"""Real clips with ground truth, where this machine has them."""

from __future__ import annotations

import csv
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

DEFAULT_FOLDER = Path(__file__).resolve().parents[1] / "../shared/clips"


@dataclass(frozen=True)
class Clip:
    """A video, the frame and box to start from, and the true centre by frame."""

    path: Path
    start: int
    box: tuple[float, float, float, float]
    centres: dict[int, tuple[float, float]]

    def distance(self, frame: int, x: float, y: float) -> float:
        return float(np.hypot(x - self.centres[frame][0], y - self.centres[frame][1]))


def clip(name: str, start: int, box: tuple[float, float, float, float]) -> Clip:
    """The clip called ``name``; skips the test where it is absent."""
    folder = Path(os.environ.get("PFVIZ_CLIPS", DEFAULT_FOLDER)) / name
    if not (folder / "video.mp4").is_file():
        pytest.skip(f"no clip '{name}' in {folder.parent} (set PFVIZ_CLIPS to the folder that has it)")
    with (folder / "truth.csv").open(newline="") as stream:
        centres = {int(row["frame"]): (float(row["cx"]), float(row["cy"])) for row in csv.DictReader(stream)}
    return Clip(folder / "video.mp4", start, box, centres)
