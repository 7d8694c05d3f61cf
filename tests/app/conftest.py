from __future__ import annotations

from pathlib import Path

import pytest
from stand_ins import write_disc_video

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
