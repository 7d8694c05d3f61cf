"""The examples run, and write and print what they say."""

import csv
import re
import runpy
import sys
from pathlib import Path

import cv2
import pytest

from pfviz.vision import open_source

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


def run_example(name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """What an example prints."""
    monkeypatch.setattr(sys, "argv", [name, *words])
    runpy.run_path(str(EXAMPLES / name), run_name="__main__")
    return capsys.readouterr().out


def test_every_example_is_run_here():
    assert [path.name for path in sorted(EXAMPLES.glob("*.py"))] == [
        "01_one_step_in_stages.py",
        "02_a_world_of_your_own.py",
        "03_figures_for_slides.py",
        "04_track_a_clip.py",
    ]


def test_one_step_in_stages(monkeypatch, capsys):
    printed = run_example("01_one_step_in_stages.py", monkeypatch, capsys)
    sizes = [float(size) for size in re.findall(r"effective sample size ([\d.]+) of 24", printed)]
    assert len(sizes) == 2 and sizes[1] > 1.5 * sizes[0]
    assert re.findall(r"^  (\w+)", printed, re.MULTILINE) == [
        *("resample", "propose", "associate", "complete", "weight"),
        *("propose", "associate", "complete", "weight"),
    ]


def test_a_world_of_ones_own(monkeypatch, capsys):
    printed = run_example("02_a_world_of_your_own.py", monkeypatch, capsys)
    pairs = re.findall(r"particle mean ([+-][\d.]+), exact ([+-][\d.]+)", printed)
    assert len(pairs) == 4
    assert all(abs(float(mean) - float(exact)) < 0.03 for mean, exact in pairs)


def test_figures_for_slides(monkeypatch, capsys, tmp_path):
    printed = run_example("03_figures_for_slides.py", monkeypatch, capsys, str(tmp_path))
    names = [f"{name}.{kind}" for name in ("basic-sir", "rb-hs-sir") for kind in ("pdf", "png", "svg")]
    names = sorted([*names, "over-time.png"])
    assert sorted(path.name for path in tmp_path.iterdir()) == names
    assert all(name in printed for name in names)
    assert min(cv2.imread(str(path)).shape[0] for path in tmp_path.glob("*.png")) > 500


def test_track_a_clip(monkeypatch, capsys, tmp_path):
    printed = run_example("04_track_a_clip.py", monkeypatch, capsys, "scene:twin", "5", str(tmp_path))
    assert printed.startswith("5 frames; at the end x = ")
    with open(tmp_path / "track.csv", newline="") as table:
        rows = list(csv.DictReader(table))
    with open_source("scene:twin") as source, open_source(str(tmp_path / "track.mp4")) as video:
        assert len(rows) == video.frame_count == 5 and video.size == source.size
        for row in rows:
            truth = source.truth(int(row["frame"]))
            assert truth is not None
            assert abs(float(row["x"]) - truth[0]) < 5 and abs(float(row["y"]) - truth[1]) < 5
    assert cv2.imread(str(tmp_path / "last-frame.png")).shape[0] > 500


def test_a_clip_that_does_not_say_where_its_object_is(monkeypatch, capsys, tmp_path):
    path = tmp_path / "clip.mp4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 25.0, (64, 48))
    writer.write(cv2.UMat(48, 64, cv2.CV_8UC3).get())
    writer.release()
    with pytest.raises(SystemExit, match="does not say where the object is: set box to"):
        run_example("04_track_a_clip.py", monkeypatch, capsys, str(path), "5", str(tmp_path))
