"""What the picture holds, and what a visitor can do with it."""

import numpy as np
import pytest
from pfviz_app.stage.palette import DARK

from pfviz.filters import FILTERS
from pfviz.worlds import WORLDS

pytestmark = pytest.mark.e2e

PRIOR = ["toy.title", "toy.facts", "toy.older", "toy.newer", "toy.pairs", "tracker.title", "tracker.frame"]
ITERATION = [
    *("toy.older", "toy.newer", "toy.proposed", "toy.proposal", "toy.likelihood", "toy.observation", "toy.made"),
    *("toy.heads", "toy.possible", "toy.history", "toy.state", "toy.new", "toy.posterior", "toy.exact", "toy.truth"),
    *("toy.estimate", "tracker.frame", "tracker.frame.expected", "tracker.close", "tracker.close.centres"),
    *("tracker.close.arrows", "tracker.close.expected", "tracker.close.likely"),
]
N = WORLDS["figure-1"].n_particles


def step(visitor):
    t = visitor.time
    visitor.click("Step ▶")
    visitor.at(t + 1)
    visitor.sees("toy.made", "tracker.close")


def test_before_the_first_step_there_is_the_prior_and_then_the_whole_iteration(visitor):
    visitor.sees(*PRIOR)
    assert visitor.time == 0
    assert len(visitor.points("toy.newer")) == len(visitor.points("toy.older")) == visitor.lines("toy.pairs") == N == 24
    assert visitor.lines("toy.made") == 0
    step(visitor)
    visitor.says("Paused")
    visitor.sees(*ITERATION)
    assert visitor.lines("toy.made") == N
    assert visitor.lines("toy.heads") == 2 * N
    for row in ("toy.older", "toy.newer", "toy.proposed", "toy.history", "toy.state"):
        assert len(visitor.points(row)) == N
    assert 0 < visitor.lines("toy.possible") <= 160
    assert 0 < visitor.lines("tracker.close.arrows") <= 120
    assert_arrows_lead_from_a_state_to_an_innovation(visitor)


def assert_arrows_lead_from_a_state_to_an_innovation(visitor):
    states, proposed = visitor.points("toy.newer"), visitor.points("toy.proposed")
    for name in ("toy.made", "toy.possible"):
        ends = visitor.points(name).reshape(-1, 2, 3)
        assert set(ends[:, 0, 0].tolist()) <= set(states[:, 0].tolist())
        assert set(ends[:, 1, 0].tolist()) <= set(proposed[:, 0].tolist())
        assert np.unique(ends[:, :, 1], axis=0).tolist() == [[states[0, 1], proposed[0, 1]]]


def test_weights_change_with_every_step_and_come_back(visitor):
    looks = []
    for _ in range(2):
        step(visitor)
        looks.append((visitor.look("toy.state"), visitor.look("tracker.close.centres")))
    assert looks[0][0] != looks[1][0]
    assert looks[0][1] != looks[1][1]
    assert len(colours_of(visitor, "toy.state")) > 3
    visitor.click("◀ Back")
    visitor.at(1)
    visitor.until(lambda: (visitor.look("toy.state"), visitor.look("tracker.close.centres")) == looks[0])


def test_each_filter_shows_what_it_does(visitor):
    """Strength is colour and thickness: the thinnest arrows are joins that are next to impossible."""
    step(visitor)
    innovations, weak = visitor.points("toy.proposed"), visitor.lines("toy.made.0")
    visitor.choose("Filter", FILTERS["basic-sir"].title)
    visitor.sees_no("toy.possible")
    assert visitor.lines("toy.made") == N
    assert visitor.lines("toy.made.0") > max(N // 2, 2 * weak)
    np.testing.assert_array_equal(visitor.points("toy.proposed"), innovations)
    visitor.choose("Filter", FILTERS["condensation"].title)
    visitor.sees_no("toy.proposal")
    visitor.until(lambda: visitor.lines("toy.made") == N)
    assert not np.array_equal(visitor.points("toy.proposed"), innovations)
    visitor.choose("Filter", FILTERS["rb-hs-sir"].title)
    visitor.sees("toy.possible", "toy.proposal")
    assert visitor.lines("toy.made") == N
    assert visitor.lines("toy.made.0") == weak
    np.testing.assert_array_equal(visitor.points("toy.proposed"), innovations)
    assert visitor.time == 1


def test_all_filters_can_be_switched_through_while_it_plays(visitor):
    visitor.type("Steps / second", 2)
    visitor.type("Particles, video", 100)
    visitor.click("▶ Play")
    visitor.until(lambda: visitor.time >= 1)
    for info in (*FILTERS.values(), FILTERS["basic-sir"]):
        visitor.choose("Filter", info.title)
        t = visitor.time
        visitor.until(lambda t=t: visitor.time > t, f"time to go on with {info.title}")
        visitor.page.get_by_role("heading", name=info.title, exact=True).first.wait_for()
    visitor.until(lambda: visitor.lines("toy.made") == N)
    visitor.click("❚❚ Pause")
    visitor.says("Paused")


def test_the_plane_is_another_room(visitor):
    step(visitor)
    visitor.choose("Toy world", WORLDS["plane"].title)
    visitor.at(0)
    visitor.sees("toy.before", "toy.floor.before")
    visitor.sees_no("toy.older", "toy.line", "toy.made")
    step(visitor)
    visitor.sees("toy.floor.proposed", "toy.proposed", "toy.possible", "toy.after", "toy.truth", "toy.observation")
    n = WORLDS["plane"].n_particles
    assert visitor.lines("toy.made") == len(visitor.points("toy.proposed")) == len(visitor.points("toy.after")) == n
    assert visitor.value("Particles, toy") == n
    assert len(np.unique(visitor.points("toy.made").reshape(-1, 2, 3)[:, :, 2])) > 2, "arrows go from floor to floor"


def test_panes(visitor):
    step(visitor)
    visitor.choose("Show", "the toy")
    visitor.sees_no("tracker.")
    _, _, width, _ = visitor.canvas()
    assert np.ptp(visitor.points("toy.line.newer")[:, 0]) > 0.6 * width
    visitor.choose("Show", "the video")
    visitor.sees_no("toy.")
    visitor.sees("tracker.close")
    visitor.choose("Show", "both rooms")
    visitor.sees("toy.made", "tracker.close")


def test_what_is_to_be_shown_and_in_which_colours(visitor):
    step(visitor)
    visitor.open("Look")
    visitor.page.get_by_label("Show the truth", exact=True).click()
    visitor.sees_no("toy.truth", "tracker.close.truth")
    visitor.page.get_by_label("Show the exact posterior", exact=True).click()
    visitor.sees_no("toy.exact")
    visitor.type("Arrows", 5)
    visitor.until(lambda: visitor.lines("toy.made") == 5)
    assert visitor.lines("toy.possible") == visitor.lines("tracker.close.arrows") == 5
    visitor.type("Arrows", 0)
    visitor.sees_no("toy.made", "toy.possible", "tracker.close.arrows")
    light = colours_of(visitor, "toy.proposed")
    visitor.page.get_by_label("Dark colours", exact=True).click()
    visitor.until(lambda: colours_of(visitor, "toy.proposed") not in ([], light))
    visitor.page.locator('html[data-mantine-color-scheme="dark"]').wait_for()
    visitor.click("↺ Reset")
    visitor.until(lambda: colours_of(visitor, "toy.newer") == [DARK.history])


def colours_of(visitor, name):
    looks = visitor.look(name).values()
    return sorted({tuple(colour) for _, colours in looks for colour in np.reshape(colours, (-1, 3))})


def test_a_particle_that_is_clicked_gives_its_receipt(visitor):
    step(visitor)
    visitor.page.get_by_role("tab", name="Receipt").click()
    x, y, _ = visitor.points("toy.state")[0]
    left, top, _, _ = visitor.canvas()
    visitor.page.mouse.click(left + x, top - y)
    visitor.sees("toy.chosen")
