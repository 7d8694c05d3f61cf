from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from stand_ins import disc_frame, write_disc_video

from pfviz import kernels


@pytest.fixture(scope="session", autouse=True)
def compiled_kernels() -> None:
    """A session keeps its backend until it is reset: compile now, so that no test begins on one and ends on another."""
    kernels.warm_up()


@pytest.fixture(scope="session")
def disc_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A video of 12 frames of a moving disc; do not write to its folder."""
    return write_disc_video(tmp_path_factory.mktemp("video") / "disc.mp4")


@pytest.fixture
def workplace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder that is the current one."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def late_disc(tmp_path) -> Path:
    """Images in which the disc is absent until frame 20."""
    folder = tmp_path / "late"
    folder.mkdir()
    empty = np.array(disc_frame(0))
    empty[20:52, 5:40] = 205
    for index in range(40):
        cv2.imwrite(str(folder / f"{index}.png"), empty if index < 20 else disc_frame(index))
    return folder
