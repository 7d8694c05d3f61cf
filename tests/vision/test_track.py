"""A run over a video: its rows, its replay, and the video drawn from it."""

from __future__ import annotations

import csv
import io

import numpy as np
import pytest

from pfviz.filters import make_filter
from pfviz.randomness import step_rng
from pfviz.vision.drawing import VideoWriter, draw_track, likely_states
from pfviz.vision.presence import AT_START
from pfviz.vision.scenes import Scene
from pfviz.vision.track import CSV_HEADER, TrackedFrame, track, write_csv
from pfviz.vision.tracker import TrackerModel, learn_tracker
from pfviz.vision.video import VideoError, frames, open_source

START = 140


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene(0)


@pytest.fixture(scope="module")
def model(scene) -> TrackerModel:
    return learn_tracker(scene.read(START), scene.box(START))


def run(scene: Scene, model: TrackerModel, seed: int = 0, start: int = START) -> list[TrackedFrame]:
    return list(track(scene, model, make_filter("rb-ss-hs-sir", n_particles=100), seed, start))


def test_there_is_one_row_a_frame_from_the_start_frame_on(scene, model):
    stream = io.StringIO()
    assert write_csv(stream, run(scene, model)) == 10
    text = stream.getvalue()
    assert text.startswith("frame,x,y,rotation,scale,box_x,box_y,box_w,box_h,ess,milliseconds\n")
    rows = list(csv.DictReader(io.StringIO(text)))
    assert [int(row["frame"]) for row in rows] == list(range(140, 150))
    assert all(np.isfinite(float(value)) for row in rows for value in row.values())


def test_the_rows_say_where_the_object_is(scene, model):
    for item in run(scene, model):
        row = dict(zip(CSV_HEADER, item.row, strict=True))
        x, y, *_ = scene.truth(item.frame)
        assert np.hypot(row["x"] - x, row["y"] - y) < 6.0
        assert row["box_x"] < x < row["box_x"] + row["box_w"]
        assert row["box_y"] < y < row["box_y"] + row["box_h"]
        assert 1.0 <= row["ess"] <= 100.0
        assert row["milliseconds"] > 0.0
    first = run(scene, model)[0].estimate
    assert first.scale == pytest.approx(1.0, abs=0.1)
    assert first.rotation == pytest.approx(0.0, abs=0.15)


def test_equal_seeds_give_equal_rows_and_others_do_not(scene, model):
    one, same, other = (np.array([item.row[:-1] for item in run(scene, model, s)]) for s in (3, 3, 4))
    np.testing.assert_array_equal(one, same)
    assert (one[:, 1] != other[:, 1]).all()


def test_any_step_can_be_replayed_alone(scene, model):
    filter = make_filter("rb-ss-hs-sir", n_particles=100)
    presence = AT_START
    for t, item in enumerate(run(scene, model, seed=5), start=1):
        again = filter.step(step_rng(5, t), model.given(presence), item.record.previous, model.observe(item.image))
        presence = item.presence
        np.testing.assert_array_equal(again.posterior.states, item.record.posterior.states)
        np.testing.assert_array_equal(again.posterior.log_weights, item.record.posterior.log_weights)


def test_rows_are_written_as_frames_come(scene, model):
    stream = io.StringIO()

    def watched():
        for count, item in enumerate(run(scene, model)):
            assert stream.getvalue().count("\n") == count + 1
            yield item

    write_csv(stream, watched())


def test_contours_are_drawn_where_the_particles_are_and_nowhere_else(scene, model):
    item = run(scene, model)[0]
    drawn = draw_track(item.image, model, item.record, item.estimate)
    changed = (drawn != item.image).any(axis=2)
    x, y, w, h = item.estimate.box
    rows, columns = np.nonzero(changed)
    assert 100 < changed.sum() < 3000
    assert rows.min() > y - 15 and rows.max() < y + h + 15
    assert columns.min() > x - 15 and columns.max() < x + w + 15
    expected = model.contour.outlines(item.estimate.state)[0]
    on_contour = drawn[expected[:, 1].astype(int), expected[:, 0].astype(int)]
    assert np.median(on_contour) > 200
    assert (drawn[changed].max(axis=1) < 60).any()


def test_the_likely_states_are_the_heaviest_and_differ(scene, model):
    record = run(scene, model)[2].record
    states = likely_states(record, 12)
    weighed = record.stage("weight").particles
    np.testing.assert_array_equal(states[0], weighed.innovation[np.argmax(weighed.log_weights)])
    assert len(np.unique(states, axis=0)) == len(states) <= 12


def test_a_video_appears_when_it_is_complete(tmp_path, scene):
    path = tmp_path / "out.mp4"
    with VideoWriter(path, scene.size, 30.0) as writer:
        for index in range(12):
            writer.write(scene.read(index))
        assert not path.exists()
    assert [p.name for p in tmp_path.iterdir()] == ["out.mp4"]
    with open_source(path) as written:
        assert written.size == scene.size
        seen = [image for _, image in frames(written)]
    assert len(seen) == 12
    assert np.abs(seen[5].astype(int) - scene.read(5)).mean() < 8.0


def test_a_video_that_is_broken_off_leaves_nothing_and_harms_nothing(tmp_path, scene):
    path = tmp_path / "out.mp4"
    path.write_bytes(b"an earlier film")
    with pytest.raises(KeyboardInterrupt), VideoWriter(path, scene.size, 30.0) as writer:
        writer.write(scene.read(0))
        raise KeyboardInterrupt
    assert [p.name for p in tmp_path.iterdir()] == ["out.mp4"]
    assert path.read_bytes() == b"an earlier film"


@pytest.mark.parametrize(("name", "trouble"), [("no/such/out.mp4", "no folder"), ("", "is a folder")])
def test_where_no_video_can_be_written_is_said(tmp_path, name, trouble):
    with pytest.raises(VideoError, match=trouble):
        VideoWriter(tmp_path / name, (64, 48), 30.0)
