"""What is taken away gives the recorded numbers again: scripts by running them, tables by working the weights out."""

from __future__ import annotations

import contextlib
import csv
import io
import json
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text
from pfviz_app import exports
from pfviz_app.films import Start, ToyFilm, VideoFilm
from pfviz_app.lane import Lane
from pfviz_app.picture import Picture
from pfviz_app.receipt import receipt
from pfviz_app.room import Room
from pfviz_app.served import prepare_video
from pfviz_app.settings import Settings
from pfviz_app.start_box import Assumptions
from pfviz_app.takeaways import TAKEAWAYS
from stand_ins import DISC_BOX, DISC_OUTLINE, DiscVideo, disc_setup, write_positions

from pfviz import kernels
from pfviz.dynamics import learn_dynamics, read_states
from pfviz.figures.style import EXACT
from pfviz.filters import FILTERS
from pfviz.genealogy import first_of_equals, unique_ancestors
from pfviz.vision import Limits, open_source
from pfviz.worlds import WORLDS, get_world

ROOT = Path(__file__).resolve().parents[2]
every_filter = pytest.mark.parametrize("name", FILTERS)


@pytest.fixture(autouse=True)
def one_backend():
    with kernels.use_numpy():
        yield


def lane_of(settings: Settings, steps: int, held: dict[int, np.ndarray] | None = None, **video: Any) -> Lane:
    film = ToyFilm(get_world(settings.world), settings.seed, held)
    lane = Lane(settings, film, VideoFilm(disc_setup(lambda: DiscVideo(**{"frame_count": None, **video}))))
    for _ in range(steps):
        lane.step()
    return lane


FEW = Settings(toy_particles=12, tracker_particles=20, seed=3)


def executed(script: str) -> list[dict[str, str]]:
    """What a script prints, as the rows of a table."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(script, "script", "exec"), {"__name__": "__main__"})
    return list(csv.DictReader(io.StringIO(printed.getvalue())))


def run_alone(script: str, folder: Path) -> list[dict[str, str]]:
    """The same in a process of its own, which knows of nothing but the library."""
    (folder / "script.py").write_text(script, encoding="utf-8")
    start = f"import sys, runpy; sys.path.insert(0, {str(ROOT / 'src')!r}); runpy.run_path('script.py')"
    done = subprocess.run([sys.executable, "-c", start], capture_output=True, text=True, check=True, cwd=folder)
    return list(csv.DictReader(io.StringIO(done.stdout)))


def check_toy(rows: list[dict[str, str]], room: Room[ToyFilm]) -> None:
    """Every number, to the last digit."""
    assert len(rows) == room.trace.last
    for t, row in enumerate(rows, start=1):
        record = room.trace[t]
        values = [t, *record.estimate, record.effective_sample_size, record.log_evidence]
        assert [float(text) for text in row.values()] == values


@every_filter
def test_the_script_of_a_toy_prints_what_was_recorded(name):
    settings = replace(FEW, filter=name, system=0.5, observation=1.25, proposal=2.0)
    lane = lane_of(settings, 5)
    script = exports.toy_script(lane.log, plain=True)
    check_toy(executed(script), lane.toy)
    assert "changed" not in script


@pytest.mark.parametrize("world", ["plane", "occlusion", "two-modes"])
def test_the_script_of_other_worlds(world):
    settings = replace(FEW, world=world, filter="basic-sir", tracker_particles=1)
    lane = lane_of(settings, 53 if world == "occlusion" else 4)
    rows = executed(exports.toy_script(lane.log, plain=True))
    check_toy(rows, lane.toy)
    assert ("x2" in rows[0]) == (world == "plane")


def test_the_script_knows_where_the_target_was_put():
    held = {2: np.array([1.5]), 3: np.array([-0.25])}
    lane = lane_of(FEW, 5, held)
    check_toy(executed(exports.toy_script(lane.log, held, plain=True)), lane.toy)
    assert (
        executed(exports.toy_script(lane.log, plain=True))[4]
        != executed(exports.toy_script(lane.log, held, plain=True))[4]
    )


def test_scripts_run_alone(tmp_path):
    lane = lane_of(FEW, 4)
    check_toy(run_alone(exports.toy_script(lane.log, plain=True), tmp_path), lane.toy)


def test_the_script_of_a_compiled_run_is_compiled():
    kernels.warm_up()
    film = ToyFilm(get_world("figure-1"), 3)
    room = Room(film, "rb-hs-sir", film.model(1.0, 1.0, 1.0), 12, 3)
    script = exports.toy_script([replace(FEW, filter="rb-hs-sir")] * 5)
    assert "use_numpy" not in script

    def run() -> list[dict[str, str]]:
        for _ in range(5):
            room.step()
        return executed(script)

    from contextvars import Context

    check_toy(Context().run(run), room)


def test_changed_settings_are_told_and_not_repeated():
    lane = lane_of(FEW, 2)
    lane.configure(replace(FEW, filter="basic-sir", system=2.0, tracker_particles=7))
    lane.step()
    script = exports.toy_script(lane.log, plain=True)
    assert "# Settings were changed during the run" in script
    assert "#   from step 3: Filter rb-ss-hs-sir -> basic-sir" in script
    assert "#   from step 3: System noise × 1.0 -> 2.0" in script
    assert "Particles" not in script and "Particles, video 20 -> 7" in exports.tracker_script(lane.log, "scene:twin")
    rows = executed(script)
    check_toy(rows[:2], lane_of(FEW, 2).toy)
    check_toy(rows, lane_of(FEW, 3).toy)


def test_the_script_says_what_is_of_the_visitors_own(monkeypatch):
    monkeypatch.setitem(WORLDS, "mine", replace(get_world("plane"), name="mine"))
    monkeypatch.setitem(FILTERS, "Mine", replace(FILTERS["condensation"], name="Mine", title="Mine"))
    log = [replace(FEW, world="mine", filter="Mine")]
    for name in ("mine", "Mine"):
        assert f"# {name!r} is not part of pfviz" in exports.toy_script(log)
    assert "'mine'" not in exports.tracker_script(log, "scene:twin")
    assert "'Mine' is not part" in exports.tracker_script(log, "scene:twin")
    assert "not part" not in exports.toy_script([FEW])


def check_tracker(rows: list[dict[str, str]], room: Room[VideoFilm]) -> None:
    assert len(rows) == room.trace.last
    for t, row in enumerate(rows, start=1):
        record, e = room.trace[t], room.outcome(t).model.estimate(room.trace[t])  # type: ignore[attr-defined]
        values = [t, e.x, e.y, e.rotation, e.scale, record.effective_sample_size, record.log_evidence]
        assert [float(text) for text in row.values()] == values


X, Y, W, H = DISC_BOX
STARTS = {
    "box": Start(2, ((X + 3 + W, Y), (X + 3, Y + H))),
    "outline": Start(2, ((X + 3, Y), (X + 3 + W, Y), (X + 3 + W, Y + H), (X + 3, Y + H), (X + 1, Y + H / 2))),
}


@pytest.mark.parametrize("start", STARTS.values(), ids=STARTS)
def test_the_script_of_a_video_prints_what_was_recorded(start, disc_file):
    with open_source(str(disc_file)) as source:
        settings = replace(FEW, filter="basic-sir", system=2.0, proposal=0.5)
        film = VideoFilm(disc_setup(lambda: source)).following(start)  # type: ignore[arg-type, return-value]
        lane = Lane(settings, ToyFilm(get_world(settings.world), 3), film)
        for _ in range(3):
            lane.step()
        check_tracker(executed(exports.tracker_script(lane.log, str(disc_file), start, plain=True)), lane.tracker)


def test_the_script_of_a_scene_follows_what_the_scene_suggests():
    lane = Lane(FEW, ToyFilm(get_world(FEW.world), 3), VideoFilm(prepare_video("scene:twin", None, 4)))
    lane.step()
    lane.step()
    rows = executed(exports.tracker_script(lane.log, "scene:twin", start_frame=4, plain=True))
    check_tracker(rows, lane.tracker)
    lane.tracker.film.close()


def test_the_script_of_a_video_assumes_what_was_assumed(disc_file, tmp_path):
    """Everything that ``pfviz serve`` can be told of a video and its object."""
    positions = write_positions(tmp_path / "truth.csv")
    others = (
        {"assumed": Assumptions("colour", "affine", "constant-position", 48, False), "learn_frame": 2},
        {"assumed": Assumptions(learnt_from=str(positions), learnt=learn_dynamics(read_states(positions)))},
        {"limits": Limits(max_frames=9, max_pixels=96 * 72), "learn_frame": 5},
    )
    plain = None
    for terms in others:
        setup = prepare_video(str(disc_file), None, 1, polygon=DISC_OUTLINE, **terms)  # type: ignore[arg-type]
        lane = Lane(FEW, ToyFilm(get_world(FEW.world), 3), VideoFilm(setup))
        for _ in range(3):
            lane.step()
        picture = Picture(FEW, lane, None, 3, None, 3, None, None, None, False, None, "")
        rows = executed(TAKEAWAYS["Python script, video"][1](picture).decode())
        check_tracker(rows, lane.tracker)
        assert rows != plain
        plain = rows
        lane.tracker.film.close()


def test_the_script_of_images_has_their_rate():
    script = exports.tracker_script([FEW], "frames/*.png", frame_rate=12.0)
    assert "open_source('frames/*.png', frame_rate=12.0)" in script


def test_nothing_can_be_written_of_nothing(tmp_path):
    with pytest.raises(ValueError, match="nothing has been run in the toy yet"):
        exports.toy_script([])
    with pytest.raises(ValueError, match="nothing has been run in the video yet"):
        exports.tracker_script([], "scene:twin")
    with pytest.raises(ValueError, match="nothing has been tracked yet"):
        exports.write_video(lane_of(FEW, 0).tracker, tmp_path / "a.mp4")
    assert list(tmp_path.iterdir()) == []


def table(lines: Iterable[str]) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO("".join(lines))))


def recomputed(rows: list[dict[str, str]]) -> np.ndarray:
    """The weights of one step, from the columns of the table alone."""
    factors = [name for name in rows[0] if name.startswith("log_factor_")]
    before = np.array([float(row["weight_before"]) for row in rows])
    totals = np.array([sum(float(row[name]) for name in factors if row[name]) for row in rows])
    weights = before * np.exp(totals - totals.max())
    return weights / weights.sum()


@every_filter
@pytest.mark.parametrize("place", ["toy", "video"])
def test_receipts_follow_from_the_table_of_the_trace(name, place):
    settings = replace(FEW, filter=name, world="figure-1")
    lane = lane_of(settings, 3)
    room = lane.toy if place == "toy" else lane.tracker
    rows = table(exports.trace_csv(room))
    for t in (1, 2, 3):
        step, record = [row for row in rows if row["t"] == str(t)], room.trace[t]
        shown = np.array([float(row["weight"]) for row in step])
        np.testing.assert_allclose(recomputed(step), shown, rtol=1e-9, atol=1e-300)
        for i, row in enumerate(step):
            slip = receipt(record, i)
            assert slip is not None and int(row["particle"]) == i
            assert float(row["weight"]) == slip.weight and float(row["weight_before"]) == slip.before
            filled = {key[11:]: np.exp(float(v)) for key, v in row.items() if key.startswith("log_factor_") and v}
            assert filled == dict(slip.factors)
            histories = [int(word) for word in row["histories"].split()]
            if slip.history >= 0:
                assert slip.history in first_of_equals(record.previous)[histories]
            else:
                assert not histories
            columns = ["x1"] if place == "toy" else exports.TRACKER_COMPONENTS
            state = [float(row[column]) for column in columns if row[column]]
            assert state == slip.state.tolist()
        joined = sum(len(row["histories"].split()) for row in step)
        assert joined == (len(record.posterior) if name != "icondensation" else (record.histories >= 0).sum())


def test_a_step_without_an_observation_has_no_factors():
    lane = lane_of(replace(FEW, world="occlusion", filter="auxiliary", tracker_particles=1), 52)
    rows = table(exports.trace_csv(lane.toy))
    step = [row for row in rows if row["t"] == "52"]
    assert len(step) == 12 and all(row["weight"] == row["weight_before"] and row["histories"] for row in step)
    assert not any(value for row in step for key, value in row.items() if key.startswith("log_factor_"))
    summary = table(exports.summary_csv(lane.toy))
    assert [row["t"] for row in summary if row["condition"] == "missing"] == ["51", "52"]


def test_the_summary_is_of_the_records():
    lane = lane_of(replace(FEW, world="linear-gaussian"), 12)
    rows, room = table(exports.summary_csv(lane.toy)), lane.toy
    assert [row["t"] for row in rows] == [str(t) for t in range(1, 13)]
    for t, row in enumerate(rows, start=1):
        record, exact = room.trace[t], room.exact
        assert exact is not None
        marginal = exact.marginal(t)
        assert marginal is not None
        expected = {
            "x1": record.estimate[0],
            "true_x1": room.film.truth(t)[0],
            "exact_x1": marginal.mean[0],
            "error": abs(record.estimate[0] - room.film.truth(t)[0]),
            "effective_sample_size": record.effective_sample_size,
            "log_evidence": record.log_evidence,
            "exact_log_evidence": exact.log_evidence(t),
            "ancestors_10": unique_ancestors(room.trace, t, 10),
            "milliseconds": room.outcome(t).milliseconds,
        }
        assert {key: float(row[key]) for key in expected} == pytest.approx(expected, rel=1e-15)
        assert row["filter"] == "rb-ss-hs-sir" and row["condition"] == ""
    video = table(exports.summary_csv(lane.tracker))
    truth = lane.tracker.film.truth(12)
    assert truth is not None
    assert [float(video[11][f"true_{name}"]) for name in exports.TRACKER_COMPONENTS] == truth.state.tolist()
    assert video[11]["exact_x"] == "" and video[11]["exact_log_evidence"] == ""
    away = np.hypot(*(float(video[11][name]) - float(video[11][f"true_{name}"]) for name in ("x", "y")))
    assert float(video[11]["error"]) == pytest.approx(away)


def test_json_holds_settings_changes_and_summary():
    held = {2: np.array([0.5])}
    lane = lane_of(FEW, 2, held)
    lane.configure(replace(FEW, system=2.0))
    lane.step()
    content = json.loads(exports.run_json(lane.log, lane.toy, lane.tracker, held))
    assert content["settings"]["system"] == 2.0 and content["settings"]["world"] == "figure-1"
    assert [(change["from_step"], change["system"]) for change in content["changes"]] == [(1, 1.0), (3, 2.0)]
    assert content["held"] == {"2": [0.5]}
    toy = content["toy"]
    assert toy["steps"] == 3 and toy["particles"] == 12
    assert toy["estimate"] == lane.toy.trace[3].estimate.tolist()
    assert toy["rms_error"] == pytest.approx(np.sqrt(np.mean(lane.toy.errors**2)))
    assert toy["mean_effective_sample_size"] == pytest.approx(lane.toy.effective_sample_sizes.mean())
    assert toy["log_evidence"] == pytest.approx(sum(record.log_evidence for record in lane.toy.trace))
    exact = lane.toy.exact
    assert exact is not None
    assert toy["exact_log_evidence"] == pytest.approx(sum(exact.log_evidence(t) for t in (1, 2, 3)))
    assert content["video"]["exact_log_evidence"] is None and content["video"]["rms_error"] > 0


def test_json_of_nothing():
    lane = lane_of(FEW, 0)
    content = json.loads(exports.run_json(lane.log, lane.toy, lane.tracker))
    assert content["settings"] is None and content["toy"] == {"steps": 0}


def test_the_video_shows_the_expected_contour(tmp_path):
    lane = lane_of(FEW, 4)
    parts: list[float] = []
    path = tmp_path / "tracked.mp4"
    assert exports.write_video(lane.tracker, path, parts.append) == 4
    assert parts == [0.25, 0.5, 0.75, 1.0]
    with open_source(str(path)) as written:
        assert (written.frame_count, written.size, written.frame_rate) == (4, (96, 72), 30.0)
        for t in (1, 4):
            image, plain = written.read(t - 1).astype(int), lane.tracker.film.image(t).astype(int)
            model = lane.tracker.outcome(t).model
            outline = model.contour.outlines(model.estimate(lane.tracker.trace[t]).state)[0]  # type: ignore[attr-defined]
            mask = np.zeros(image.shape[:2], np.uint8)
            cv2.polylines(mask, [np.rint(outline - 0.5).astype(np.int32)], True, 1, 1)
            near = cv2.dilate(mask, np.ones((9, 9), np.uint8)) > 0
            change = np.abs(image - plain).max(axis=2)
            assert change[mask > 0].mean() > 60 and change[~near].max() < 90


@pytest.mark.parametrize("world", ["figure-1", "plane"])
def test_figures_of_the_rooms(world):
    lane = lane_of(replace(FEW, world=world), 3)
    toy, tracker = exports.toy_figure(lane.toy, 3), exports.tracker_figure(lane.tracker, 2)
    titles = {text.get_text() for text in toy.findobj(Text)}  # type: ignore[arg-type]
    assert "RB-SS-HS-SIR, t = 3" in titles
    assert "RB-SS-HS-SIR, frame 1" in [text.get_text() for text in tracker.texts]
    black = {line.get_color() for axes in toy.axes for line in axes.get_lines()}
    plain = {line.get_color() for a in exports.toy_figure(lane.toy, 3, exact=False).axes for line in a.get_lines()}
    assert (EXACT in black) == (world == "figure-1") and EXACT not in plain
    over_time = exports.courses_figure({"toy": lane.toy, "video": lane.tracker}, 2)
    assert isinstance(over_time, Figure)
    assert over_time.axes[0].get_lines()[0].get_xdata().tolist() == [1, 2]
    alone = exports.courses_figure({"toy": lane.toy}, 3)
    against_exact = "log-evidence, minus the exact" in [axes.get_title(loc="left") for axes in alone.axes]
    assert against_exact == (world == "figure-1")
