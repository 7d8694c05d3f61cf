"""The picture in windows of every size, and of videos of one's own."""

import csv

import numpy as np
import pytest
from stand_ins import DISC_BOX, SIZE, centre, write_disc_video

from pfviz.worlds import WORLDS

pytestmark = pytest.mark.e2e

WINDOWS = {"wide": (1400, 850), "tall": (800, 1200), "phone": (390, 844)}


def step(visitor):
    t = visitor.time
    visitor.click("Step ▶")
    visitor.at(t + 1)


def hidden(visitor):
    """The nodes that are drawn beside the canvas or under something else."""
    _, _, width, height = visitor.canvas()
    faults = []
    for name, places in visitor.drawn().items():
        if (places < -1).any() or (places > [width + 1, height + 1]).any():
            faults.append(f"{name} leaves the canvas")
        some = np.array([places.min(axis=0), places.max(axis=0), *places[:: len(places) // 5 + 1]])
        if covered := visitor.covered(some.clip(1, [width - 1, height - 1])):
            faults.append(f"{name} is hidden at {covered}")
    return faults


def assert_nothing_is_hidden(visitor):
    """Everything drawn lies on the canvas and under nothing else; images take a frame to find their place."""
    faults = hidden(visitor)
    for _ in range(100):
        if not faults:
            return
        visitor.page.wait_for_timeout(100)
        faults = hidden(visitor)
    assert not faults


def choose(visitor, size, options):
    """On a phone most choices are folded away."""
    if size == WINDOWS["phone"]:
        visitor.open("More")
    for label, option in options.items():
        visitor.choose(label, option)
    if size == WINDOWS["phone"]:
        visitor.open("More")


@pytest.mark.parametrize("size", WINDOWS.values(), ids=WINDOWS)
def test_all_that_is_drawn_can_be_seen(app, visit, size):
    visitor = visit(app, *size)
    visitor.dismiss_notices()
    assert_nothing_is_hidden(visitor)
    step(visitor)
    visitor.sees("toy.made")
    assert_nothing_is_hidden(visitor)
    choose(visitor, size, {"Show": "the video"})
    visitor.sees_no("toy.")
    visitor.sees("tracker.close")
    assert_nothing_is_hidden(visitor)
    choose(visitor, size, {"Show": "the toy", "Toy world": WORLDS["plane"].title})
    visitor.at(0)
    step(visitor)
    visitor.sees("toy.floor.after")
    assert_nothing_is_hidden(visitor)


def test_the_picture_follows_the_window(app, visit):
    visitor = visit(app, 1200, 700)
    visitor.dismiss_notices()
    step(visitor)
    side_by_side = visitor.drawn()["tracker.frame"]
    for width, height in ((1000, 1100), (1500, 600), (1200, 700)):
        visitor.page.set_viewport_size({"width": width, "height": height})
        visitor.until(lambda height=height: visitor.canvas()[3] == height and fits(visitor), "the picture to fit")
        assert_nothing_is_hidden(visitor)
    np.testing.assert_allclose(visitor.drawn()["tracker.frame"], side_by_side, atol=1.0)


def fits(visitor):
    """Whether what was drawn for the canvas's size has arrived: the lowest line of the toy is at its foot."""
    _, _, width, height = visitor.canvas()
    places = np.concatenate(list(visitor.drawn().values()))
    return visitor.looks_squarely() and places[:, 0].max() > 0.85 * width and places[:, 1].max() > 0.75 * height


def centre_in_frame(visitor, size):
    """The middle of the expected contour, in pixels of the video's frame."""
    drawn = visitor.drawn()
    frame, contour = drawn["tracker.frame"], drawn["tracker.frame.expected"]
    low, high = frame.min(axis=0), frame.max(axis=0)
    middle = (contour.min(axis=0) + contour.max(axis=0)) / 2
    return (middle - low) / (high - low) * size


def test_a_video_of_ones_own(serve, visit, tmp_path):
    path = write_disc_video(tmp_path / "disc.mp4", frames=12)
    app = serve("--video", path, "--box", ",".join(map(str, DISC_BOX)), "--particles", 100)
    visitor = visit(app, 1000, 600)
    for t in range(1, 4):
        step(visitor)
        visitor.sees("tracker.close.expected")
        assert np.linalg.norm(centre_in_frame(visitor, SIZE) - centre(t - 1)) < 5.0
    visitor.sees_no("tracker.close.truth")
    visitor.type("Steps / second", 30)
    visitor.click("▶ Play")
    visitor.says("The film ends here, at step 12")
    assert visitor.time == 12
    visitor.type("Steps / second", 4)
    visitor.click("▶ Play")
    visitor.until(lambda: visitor.time < 12)
    visitor.says("The film ends here, at step 12")


def test_the_options_of_serve_are_what_the_app_begins_with(serve, visit):
    app = serve("--world", "plane", "--filter", "condensation", "--particles", 33, "--seed", 5)
    visitor = visit(app, 1000, 600)
    assert [visitor.value(label) for label in ("Particles, toy", "Particles, video", "Seed")] == [33, 33, 5]
    assert visitor.page.get_by_role("combobox", name="Filter").input_value() == "CONDENSATION"
    visitor.sees("toy.floor")
    step(visitor)
    visitor.until(lambda: len(visitor.points("toy.after")) == 33)


def test_the_flask(serve, visit, clips):
    video = clips / "flask" / "video.mp4"
    if not video.exists():
        pytest.skip(f"no clip at {video}; set PFVIZ_CLIPS to the folder that holds them")
    with (clips / "flask" / "truth.csv").open() as stream:
        truth = {int(row["frame"]): (float(row["cx"]), float(row["cy"])) for row in csv.DictReader(stream)}
    visitor = visit(serve("--video", video, "--box", "308,124,107,259"), 1000, 600)
    for frame in range(4):
        step(visitor)
        visitor.sees("tracker.close.expected")
        assert np.linalg.norm(centre_in_frame(visitor, (640, 480)) - truth[frame]) < 15.0
