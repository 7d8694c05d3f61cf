"""The command line does what its contract says."""

import csv
import io
import itertools
import json
import signal
import socket
import subprocess
import sys

import cv2
import numpy as np
import pytest
from pfviz_app import cli
from stand_ins import DISC_BOX, SIZE, centre, environment, listing, run_here, run_there

from pfviz.filters import FILTERS
from pfviz.vision.scenes import make_scene
from pfviz.worlds import WORLDS

BOX = ",".join(f"{value:g}" for value in DISC_BOX)
COLUMNS = ["frame", "x", "y", "rotation", "scale", "box_x", "box_y", "box_w", "box_h", "ess", "milliseconds"]


def rows_of(text):
    header, *rows = csv.reader(io.StringIO(text))
    assert header == COLUMNS
    return [dict(zip(COLUMNS, map(float, row), strict=True)) for row in rows]


def json_lines(text):
    return [
        json.loads(line, parse_constant=lambda name: pytest.fail(f"{name} is not JSON")) for line in text.splitlines()
    ]


def timeless(rows):
    return [{key: value for key, value in row.items() if key != "milliseconds"} for row in rows]


@pytest.fixture
def caught(monkeypatch):
    """The options of the commands that would have been run."""
    options = []
    monkeypatch.setattr(cli, "_COMMANDS", dict.fromkeys(cli._COMMANDS, options.append))
    return options


def test_pfviz_alone_is_pfviz_serve(capfd, caught):
    for words in ([], ["serve"], ["--port", "9000"], ["serve", "--port", "9000"]):
        assert run_here(capfd, *words).code == 0
    assert [options.command for options in caught] == ["serve"] * 4
    assert vars(caught[0]) == vars(caught[1])
    assert vars(caught[2]) == vars(caught[3])


def test_the_app_listens_to_this_machine_only_unless_told(capfd, caught):
    run_here(capfd)
    run_here(capfd, "--host", "0.0.0.0")
    assert [options.host for options in caught] == ["127.0.0.1", "0.0.0.0"]


@pytest.mark.parametrize("words", [[], ["serve"], ["toy"], ["track"], ["worlds"], ["filters"], ["models"]])
def test_help_is_everywhere(capfd, words):
    outcome = run_here(capfd, *words, "--help")
    assert outcome.code == 0
    assert outcome.out.startswith("usage: pfviz")
    assert outcome.err == ""


@pytest.mark.parametrize(("command", "table", "key"), [("worlds", WORLDS, "world"), ("filters", FILTERS, "filter")])
def test_the_lists(capfd, command, table, key):
    outcome = run_here(capfd, command)
    assert (outcome.code, outcome.err) == (0, "")
    assert [line.split()[0] for line in outcome.out.splitlines()] == list(table)
    outcome = run_here(capfd, command, "--json")
    assert [line[key] for line in json_lines(outcome.out)] == list(table)


def test_toy_as_a_table_for_people(capfd):
    outcome = run_here(capfd, "toy", "--steps", 3, "--particles", 10)
    assert (outcome.code, outcome.err) == (0, "")
    assert len(outcome.out.splitlines()) == 4


@pytest.mark.parametrize("filter_name", FILTERS)
@pytest.mark.parametrize("world", WORLDS)
def test_toy_gives_json_whatever_the_world_and_the_filter(capfd, world, filter_name):
    words = ("--world", world, "--filter", filter_name, "--particles", 3, "--steps", 6, "--seed", 1, "--json")
    header, *steps = json_lines(run_here(capfd, "toy", *words).out)
    assert (header["world"], header["filter"], header["particles"], header["seed"]) == (world, filter_name, 3, 1)
    assert [step["t"] for step in steps] == list(range(1, 7))


def test_one_particle_is_enough(capfd, disc_file):
    for name in FILTERS:
        assert run_here(capfd, "toy", "--filter", name, "--particles", 1, "--json").code == 0
        assert run_here(capfd, "track", disc_file, "--box", BOX, "--filter", name, "--particles", 1).code == 0


def test_track_prints_a_table_where_nothing_else_is_asked_for(capfd, disc_file):
    outcome = run_here(capfd, "track", disc_file, "--box", BOX, "--particles", 60)
    assert (outcome.code, outcome.err) == (0, "")
    rows = rows_of(outcome.out)
    assert [row["frame"] for row in rows] == list(range(12))
    for i, row in enumerate(rows):
        x, y = centre(i)
        assert np.hypot(row["x"] - x, row["y"] - y) < 6.0
        assert row["box_x"] <= row["x"] <= row["box_x"] + row["box_w"]
        assert row["box_y"] <= row["y"] <= row["box_y"] + row["box_h"]
        assert 1.0 <= row["ess"] <= 60.0
        assert row["milliseconds"] > 0.0
        assert 0.5 < row["scale"] < 2.0


def test_track_writes_what_it_is_asked_for_and_only_that(capfd, workplace, disc_file):
    words = ("track", disc_file, "--box", BOX, "--particles", 20, "--csv", "out.csv", "--output", "out.mp4", "--json")
    outcome = run_here(capfd, *words)
    assert (outcome.code, outcome.err) == (0, "")
    assert listing(workplace) == ["out.csv", "out.mp4"]
    rows, lines = rows_of((workplace / "out.csv").read_text()), json_lines(outcome.out)
    assert len(rows) == len(lines) == 12
    for row, line in zip(rows, lines, strict=True):
        assert list(line)[: len(COLUMNS)] == COLUMNS
        assert list(row.values()) == pytest.approx([line[column] for column in COLUMNS], rel=1e-4)
        assert line["state"] == "tracked" and 0.5 < line["presence"] <= 1.0


def frames_of(path):
    capture = cv2.VideoCapture(str(path))
    images = []
    while True:
        read, image = capture.read()
        if not read:
            return images, capture.get(cv2.CAP_PROP_FPS)
        images.append(image)


def test_the_drawn_video_has_every_frame_with_a_white_contour_where_the_object_is(capfd, workplace, disc_file):
    words = ("track", disc_file, "--box", BOX, "--particles", 60, "--csv", "out.csv", "--output", "out.mp4")
    assert run_here(capfd, *words).out == ""
    images, rate = frames_of(workplace / "out.mp4")
    originals, original_rate = frames_of(disc_file)
    assert len(images) == len(originals) == 12
    assert rate == pytest.approx(original_rate)
    for image, original, row in zip(images, originals, rows_of((workplace / "out.csv").read_text()), strict=True):
        assert image.shape == original.shape == (SIZE[1], SIZE[0], 3)
        changed = np.abs(image.astype(int) - original).max(axis=2) > 60
        ys, xs = np.nonzero(changed)
        assert len(xs) > 20
        assert abs(xs.mean() - row["x"]) < 6 and abs(ys.mean() - row["y"]) < 6
        assert image[changed].min(axis=1).max() > 150


def test_track_starts_where_it_is_told(capfd, disc_file):
    box = f"{DISC_BOX[0] + 1.5 * 7:g},26,20,20"
    outcome = run_here(capfd, "track", disc_file, "--box", box, "--start-frame", 7, "--particles", 40)
    rows = rows_of(outcome.out)
    assert [row["frame"] for row in rows] == list(range(7, 12))
    assert abs(rows[0]["x"] - centre(7)[0]) < 4.0


@pytest.mark.parametrize("filter_name", FILTERS)
def test_a_scene_needs_no_box_and_a_seed_is_a_run(capfd, filter_name):
    words = ("track", "scene:twin", "--start-frame", 135, "--particles", 25, "--filter", filter_name)
    outcomes = [run_here(capfd, *words, "--seed", seed) for seed in (1, 1, 2)]
    assert all(outcome.code == 0 and outcome.err == "" for outcome in outcomes)
    first, again, other = (timeless(rows_of(outcome.out)) for outcome in outcomes)
    assert first == again != other
    assert [row["frame"] for row in first] == list(range(135, 150))
    x, y, _, _ = make_scene("twin").truth(135)
    assert np.hypot(first[0]["x"] - x, first[0]["y"] - y) < 15.0


def test_the_whole_scene_as_csv(capfd, workplace):
    outcome = run_here(capfd, "track", "scene:twin", "--csv", "twin.csv", "--particles", 50)
    assert (outcome.code, outcome.out, outcome.err) == (0, "", "")
    rows = rows_of((workplace / "twin.csv").read_text())
    assert [row["frame"] for row in rows] == list(range(150))
    assert np.isfinite([list(row.values()) for row in rows]).all()


@pytest.mark.parametrize("model", ["contour", "colour", "contour+colour"])
def test_every_measurement_model_finds_the_disc(capfd, disc_file, model):
    outcome = run_here(capfd, "track", disc_file, "--box", BOX, "--model", model, "--particles", 100)
    last = rows_of(outcome.out)[-1]
    assert np.hypot(last["x"] - centre(11)[0], last["y"] - centre(11)[1]) < 6.0


def test_python_m_pfviz_app_is_pfviz(capfd, tmp_path):
    words = ("toy", "--steps", 2, "--particles", 4, "--json")
    there = run_there(*words, cwd=tmp_path)
    assert (there.code, there.err) == (0, "")
    assert there.out == run_here(capfd, *words).out


def test_who_reads_only_the_first_line_gets_no_complaint(tmp_path):
    command = [sys.executable, "-m", "pfviz_app", "toy", "--steps", "5000", "--particles", "2", "--json"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment(), cwd=tmp_path, text=True
    ) as process:
        assert process.stdout and process.stderr
        assert json.loads(process.stdout.readline())["particles"] == 2
        process.stdout.close()
        assert process.stderr.read() == ""
        assert process.wait(60) == 0


def said_by(process, word):
    """The line of the app that holds ``word``, and those before it."""
    lines = []
    for line in process.stdout:
        lines.append(line)
        if word in line:
            return lines
    pytest.fail(f"the app ended without saying {word!r}: {lines}")


def start(*words):
    command = [sys.executable, "-m", "pfviz_app", *map(str, words)]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, env=environment(), text=True, encoding="utf-8"
    )


def test_without_a_port_the_next_free_one_is_taken_and_said():
    with socket.socket() as other:
        try:
            other.bind(("127.0.0.1", 8080))
        except OSError:
            pass  # in use already, which is as good
        else:
            other.listen()
        with start("serve", "--no-browser") as process:
            lines = said_by(process, "running at")
            process.send_signal(signal.SIGINT)
            rest = process.stdout.read()
            assert process.wait(30) == 0
    (port,) = (int(word.rsplit(":", 1)[1]) for word in lines[-1].split() if word.startswith("http://localhost:"))
    assert port > 8080
    assert any("8080 is in use" in line and str(port) in line for line in lines)
    assert "Traceback" not in rest


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupt_keeps_what_is_done_and_says_so(tmp_path, number, code):
    outputs = ["--csv", tmp_path / "out.csv", "--output", tmp_path / "out.mp4", "--contact-sheet", tmp_path / "out.png"]
    with start("track", "scene:twin", "--particles", 5000, "--json", *outputs) as process:
        assert json.loads(next(itertools.islice(process.stdout, 3, None)))["frame"] == 3
        process.send_signal(number)
        *lines, said = process.stdout.read().splitlines()
        assert process.wait(30) == code
    count = 4 + len(lines)
    assert json.loads(lines[-1] if lines else '{"frame": 3}')["frame"] == count - 1 < 149
    assert said.startswith(f"pfviz: interrupted after {count} frames; they are kept in ")
    assert all(name in said for name in ("out.csv", "out.mp4", "out.png"))
    assert listing(tmp_path) == ["out.csv", "out.mp4", "out.png"]
    assert [row["frame"] for row in rows_of((tmp_path / "out.csv").read_text())] == list(range(count))
    assert len(frames_of(tmp_path / "out.mp4")[0]) == count
    assert cv2.imread(str(tmp_path / "out.png")) is not None
