"""Comparing, branching, taking hold, following, keeping: what a visitor can do beyond playing."""

import random

import cv2
import numpy as np
import pytest
from pfviz_app.scenarios import SCENARIOS
from stand_ins import write_disc_video

from pfviz.filters import FILTERS

pytestmark = pytest.mark.e2e


def steps(visitor, count):
    for _ in range(count):
        t = visitor.time
        visitor.click("Step ▶")
        visitor.at(t + 1)
    visitor.sees("toy.made", "tracker.close")


def in_window(visitor, name):
    """Where the node ``name`` lies in the window."""
    left, top, _, _ = visitor.canvas()
    return visitor.drawn()[name].mean(axis=0) + np.array([left, top])


def press_at(visitor, place, *places, moves=4):
    """Press the mouse at a place of the window, drag it through others and let go."""
    mouse = visitor.page.mouse
    mouse.move(*place)
    mouse.down()
    for x, y in places:
        mouse.move(x, y, steps=moves)
        visitor.page.wait_for_timeout(150)
    mouse.up()


def test_two_filters_on_the_same_random_numbers(visitor):
    steps(visitor, 2)
    visitor.choose("Compare with", FILTERS["basic-sir"].title)
    visitor.sees("rival.toy.made", "rival.tracker.close")
    assert visitor.time == 2
    own, rival = visitor.points("toy.proposed"), visitor.points("rival.toy.proposed")
    np.testing.assert_array_equal(own[:, 0], rival[:, 0])
    assert own[0, 1] > rival[0, 1], "one above the other"
    visitor.page.get_by_role("tab", name="Compare").click()
    visitor.page.get_by_role("columnheader", name=FILTERS["basic-sir"].title).wait_for()
    visitor.says("likelihoods")
    visitor.choose("Compare with", "nothing")
    visitor.sees_no("rival.")


def test_a_branch_goes_on_beside_what_was_kept(visitor):
    steps(visitor, 2)
    visitor.click("Branch here")
    visitor.sees("rival.toy.state")
    states = visitor.points("toy.state")[:, 0].tolist(), visitor.points("rival.toy.state")[:, 0].tolist()
    assert states[0] == states[1]
    visitor.choose("Filter", FILTERS["condensation"].title)
    visitor.until(lambda: visitor.points("toy.state")[:, 0].tolist() != states[0])
    assert visitor.points("rival.toy.state")[:, 0].tolist() == states[1]
    steps(visitor, 1)


def test_the_target_is_dragged_and_chased(visitor):
    steps(visitor, 1)
    truth, states = visitor.points("toy.truth")[:, 0], visitor.points("toy.state")[:, 0].tolist()
    x, y = in_window(visitor, "toy.grab")
    press_at(visitor, (x, y), (x + 20, y), (x + 40, y + 3))
    visitor.until(lambda: abs(visitor.points("toy.truth")[0, 0] - truth[0] - 40) < 6, "the target to be there")
    visitor.until(lambda: visitor.points("toy.state")[:, 0].tolist() != states)
    assert visitor.time == 1
    assert visitor.looks_squarely(), "the camera stays"
    x, y = in_window(visitor, "toy.grab")
    press_at(visitor, (x, y), (x - 40, y), moves=1)
    visitor.until(lambda: abs(visitor.points("toy.truth")[0, 0] - truth[0]) < 6, "the target where it was let go")


def test_a_particle_of_the_video_shows_its_normals_edges_and_ancestors(visitor):
    steps(visitor, 3)
    visitor.page.get_by_role("tab", name="Receipt").click()
    left, top, _, _ = visitor.canvas()
    x, y, _ = visitor.points("tracker.close.centres")[-1]
    visitor.page.mouse.click(left + x, top - y)
    visitor.sees("tracker.chosen.normals", "tracker.chosen.edges")
    visitor.says("= weight")
    visitor.open("Look")
    visitor.page.get_by_label("Show ancestors", exact=True).click()
    visitor.sees("toy.ancestors.0", "tracker.frame.ancestors.0")
    visitor.choose("Over the video", "edges")
    visitor.sees("tracker.frame.edges")


def test_a_situation_is_arranged_and_explained(visitor):
    scenario = SCENARIOS["jump"]
    visitor.choose("Situation", scenario.title)
    visitor.at(scenario.t)
    visitor.page.get_by_role("heading", name=scenario.title).wait_for()
    visitor.sees("toy.", "rival.toy.")
    visitor.sees_no("tracker.")


def test_a_link_opens_exactly_this_for_somebody_else(visitor, visit, app):
    visitor.type("Seed", 7)
    visitor.choose("Compare with", FILTERS["condensation"].title)
    steps(visitor, 2)
    visitor.click("after ›")
    visitor.at(3)
    visitor.open("Keep and share")
    code = visitor.until(lambda: visitor.page.locator("button[data-link='1']").get_attribute("data-text"))
    looks = visitor.points("toy.newer")[:, 0].tolist()
    other = visit(app, 900, 600, f"?code={code}")
    other.at(3)
    other.until(lambda: other.value("Seed") == 7)
    other.sees("rival.toy.")
    other.sees_no("toy.posterior")
    mine, theirs = np.array(looks), other.points("toy.newer")[:, 0]
    np.testing.assert_allclose(np.corrcoef(mine, theirs)[0, 1], 1.0)


def test_files_to_take_along(visitor):
    steps(visitor, 1)
    visitor.open("Keep and share")
    with visitor.page.expect_download() as download:
        visitor.click("⤓ Download")
    assert cv2.imread(str(download.value.path())) is None or download.value.suggested_filename == "pfviz-toy.png"
    assert download.value.path().read_bytes().startswith(b"\x89PNG")


def test_what_is_marked_is_followed_and_help_is_there(visitor):
    steps(visitor, 1)
    low, high = (
        visitor.drawn()["tracker.frame.expected"].min(axis=0),
        visitor.drawn()["tracker.frame.expected"].max(axis=0),
    )
    left, top, _, _ = visitor.canvas()
    visitor.page.keyboard.down("Shift")
    press_at(visitor, (left + low[0], top + low[1]), (left + high[0], top + high[1]))
    visitor.page.keyboard.up("Shift")
    visitor.says("This is its outline")
    visitor.at(0)
    steps(visitor, 1)
    visitor.press("h")
    visitor.says("play or pause")
    visitor.click("Close")
    visitor.until(lambda: visitor.page.get_by_text("play or pause").count() == 0)


def test_a_video_is_sent_and_a_file_that_is_none_refused(visitor, tmp_path):
    good, bad = write_disc_video(tmp_path / "disc.mp4"), tmp_path / "<b>bad.mp4"
    bad.write_bytes(b"not a video at all")
    visitor.open("Your own video")
    for path, answer in ((bad, "<b>bad.mp4"), (good, "mark what to follow")):
        with visitor.page.expect_file_chooser() as chooser:
            visitor.click("⤒ Upload a video")
        chooser.value.set_files(path)
        visitor.says(answer)
    steps(visitor, 1)


def test_a_hundred_deeds_of_two_visitors(visit, app):
    """No page may complain, nor the app; see the fixtures."""
    rng, visitors = random.Random(8), [visit(app, 800, 480), visit(app, 800, 480)]
    for visitor in visitors:
        visitor.type("Particles, video", 60)
    keys = ("Space", "ArrowRight", "ArrowLeft", "ArrowDown", "ArrowUp", "r", "b")
    titles = [info.title for info in FILTERS.values()]
    for _ in range(50):
        for visitor in visitors:
            left, top, width, height = visitor.canvas()
            places = [(left + width * rng.random(), top + height * rng.random()) for _ in range(2)]
            match rng.randrange(8):
                case 0:
                    visitor.page.mouse.click(*places[0])
                case 1:
                    press_at(visitor, *places)
                    visitor.press("f")
                case 2:
                    visitor.choose("Filter", rng.choice(titles))
                    visitor.page.mouse.click(left + 2, top + 2)
                case _:
                    visitor.press(rng.choice(keys))
    for visitor in visitors:
        visitor.choose("Compare with", "nothing")
        if visitor.page.get_by_text("Playing", exact=True).count():
            visitor.click("❚❚ Pause")
        visitor.says("Paused")
        visitor.click("↺ Reset")
        visitor.at(0)
