"""The commands that are copied show again what was on screen, or say what they cannot repeat."""

import json
import shlex
from dataclasses import replace

import numpy as np
import pytest
from pfviz_app.cli import build_parser
from pfviz_app.command_lines import commands_of, toy_command, tracker_command
from pfviz_app.commands import Drag, Seek, Select, Set, Step
from pfviz_app.films import Start
from pfviz_app.served import prepare_video
from pfviz_app.settings import Settings
from pfviz_app.start_box import USUAL, Assumptions
from pfviz_app.video_options import assumptions_of, limits_of
from stand_ins import DISC_BOX, DISC_OUTLINE, Visit, disc_setup, run_here

from pfviz.vision import Limits

FEW = Settings(toy_particles=12, tracker_particles=15, seed=3)


def printed(capfd, line):
    """What the command prints, without the toy's head."""
    program, *words = shlex.split(line)
    outcome = run_here(capfd, *words)
    assert (program, outcome.code, outcome.err) == ("pfviz", 0, "")
    return [row for row in map(json.loads, outcome.out.splitlines()) if "pfviz" not in row]


def check(capfd, lines, lane, t):
    """Every step on screen, to the last digit."""
    toy, video = (printed(capfd, line) for line in lines)
    assert len(toy) == t <= len(video)
    for time in range(1, t + 1):
        record, estimate = lane.toy.trace[time], lane.tracker.film.estimate(lane.tracker.trace[time])
        assert toy[time - 1]["mean"] == record.estimate.tolist()
        assert toy[time - 1]["ess"] == record.effective_sample_size
        exact = lane.toy.exact.marginal(time)
        assert toy[time - 1]["exact_mean"] == pytest.approx(exact.mean.tolist())
        assert (video[time - 1]["x"], video[time - 1]["y"]) == (estimate.x, estimate.y)
        assert video[time - 1]["ess"] == lane.tracker.trace[time].effective_sample_size


def test_noises_and_the_filter_compared_with_are_in_the_commands(capfd, disc_file):
    settings = replace(FEW, world="linear-gaussian", system=2.0, observation=0.5, proposal=1.5, rival="basic-sir")
    with Visit(settings, prepare_video(str(disc_file), DISC_BOX, 2)) as visit:
        picture = visit.do(Step(5), Seek(4))
    lines = commands_of(picture).splitlines()
    assert len(lines) == 4 and "#" not in "".join(lines)
    check(capfd, lines[:2], picture.lane, 4)
    check(capfd, lines[2:], picture.rival, 4)


def test_what_is_selected_is_in_the_command(capfd, disc_file):
    with Visit(FEW, prepare_video(str(disc_file), DISC_BOX, 0)) as visit:
        visit.do(Step(3), Select(17.03, 28.06, 35.011, 44.02))
        picture = visit.do(Step(3))
    lines = commands_of(picture).splitlines()
    check(capfd, lines, picture.lane, 3)


@pytest.mark.parametrize("learn_frame", [0, 5])
def test_what_is_assumed_is_in_the_command(disc_file, learn_frame):
    assumed = Assumptions("colour", "affine", "constant-position", 48, restart=False)
    limits = Limits(max_bytes=10**6, max_pixels=9000, max_frames=9, patience=2.5, max_memory=2 * 10**9)
    setup = prepare_video(
        str(disc_file),
        None,
        0,
        polygon=DISC_OUTLINE,
        learn_frame=learn_frame,
        assumed=assumed,
        limits=limits,
        frame_rate=12.5,
    )
    (line,) = tracker_command([FEW], setup, setup.start)
    options = build_parser().parse_args(shlex.split(line)[1:])
    assert assumptions_of(options) == assumed and limits_of(options) == limits
    assert np.array_equal(options.polygon, DISC_OUTLINE) and options.frame_rate == 12.5
    assert (options.source, options.start_frame) == (str(disc_file), 0)
    assert options.learn_frame == (learn_frame or None)


def test_motion_that_was_learnt_is_in_the_command():
    setup = replace(disc_setup(), name="scene:twin", assumed=replace(USUAL, learnt_from="my truth.csv"))
    (line,) = tracker_command([FEW], setup)
    assert "--learn-dynamics 'my truth.csv'" in line


def test_a_command_is_as_short_as_it_can_be():
    (toy,), (video,) = toy_command([FEW] * 7), tracker_command([FEW], replace(disc_setup(), name="scene:twin"))
    options = "--filter rb-ss-hs-sir --particles"
    assert toy == f"pfviz toy --world figure-1 {options} 12 --seed 3 --steps 7 --json"
    assert video == f"pfviz track scene:twin {options} 15 --seed 3 --json"


def test_what_a_command_cannot_repeat_is_said_before_it():
    with Visit(FEW) as visit:
        picture = visit.do(Step(2), Set("system", 2.0), Step(), Drag(0.4, 0.0), Set("toy_particles", 13), Step())
    toy, command, video = commands_of(picture).splitlines()
    assert toy.startswith("# ") and command.startswith("pfviz toy") and "--system-noise" not in command
    assert "from step 2 on System noise × 1.0 -> 2.0" in toy and "from step 3 on Particles, toy 12 -> 13" in toy
    assert "the target was put elsewhere at t = 3" in toy
    assert video.startswith("# The video was sent by a visitor")


@pytest.mark.parametrize("settings", [replace(FEW, world="mine"), replace(FEW, filter="mine")])
def test_what_is_of_ones_own_is_said(settings):
    comment, _ = toy_command([settings])
    assert comment.startswith("# ") and "mine is not part of pfviz" in comment


def test_before_the_first_step_there_is_a_command_too():
    with Visit(FEW) as visit:
        toy, _ = commands_of(visit.settled()).splitlines()
    assert "--steps 1" in toy


def test_a_corner_may_come_last():
    setup = replace(disc_setup(), name="a.mp4", start_frame=2)
    (line,) = tracker_command([FEW], setup, Start(2, ((35.0, 46.0), (15.0, 26.5))))
    options = build_parser().parse_args(shlex.split(line)[1:])
    assert (options.box, options.start_frame, options.learn_frame) == ((15.0, 26.5, 20.0, 19.5), 2, None)
