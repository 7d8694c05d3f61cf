"""Buttons, sliders, keys; and who comes back, and who comes second."""

import random

import pytest
from pfviz_app.settings import CONTROLS

from pfviz.worlds import WORLDS

pytestmark = pytest.mark.e2e

SLIDERS = [control for control in CONTROLS.values() if control.kind == "slider"]


def steps(visitor, count):
    for _ in range(count):
        t = visitor.time
        visitor.click("Step ▶")
        visitor.at(t + 1)


def test_buttons(visitor):
    steps(visitor, 2)
    visitor.click("◀ Back")
    visitor.at(1)
    visitor.click("↺ Reset")
    visitor.at(0)
    visitor.sees_no("toy.made", "tracker.close")
    visitor.click("◀ Back")
    visitor.click("▶ Play")
    visitor.says("Playing")
    visitor.until(lambda: visitor.time >= 3)
    visitor.sees("toy.made", "tracker.close")
    visitor.click("❚❚ Pause")
    visitor.says("Paused")
    t = visitor.time
    visitor.page.wait_for_timeout(600)
    assert visitor.time == t


def test_time_can_be_gone_back_to(visitor):
    steps(visitor, 2)
    second = visitor.look("toy.state")
    visitor.type("Time", 1)
    visitor.until(lambda: visitor.look("toy.state") != second)
    assert visitor.time == 1
    visitor.drag("Time", 0.5, 0.0, 1.0)
    visitor.until(lambda: visitor.look("toy.state") == second)
    assert visitor.time == 2
    visitor.drag("Time", 0.2, 0.9)
    visitor.click("↺ Reset")
    visitor.at(0)


def test_who_drags_the_time_while_it_plays_gets_it(visitor):
    visitor.type("Steps / second", 30)
    visitor.click("▶ Play")
    visitor.until(lambda: visitor.time >= 8)
    visitor.drag("Time", 0.1, 0.9, 0.0)
    visitor.says("Paused")
    visitor.page.wait_for_timeout(500)
    shown = visitor.time
    visitor.click("Step ▶")
    visitor.at(shown + 1)


def test_stages_are_walked_through_there_and_back(visitor):
    visitor.click("after ›")
    visitor.sees("toy.proposed")
    visitor.sees_no("toy.made", "toy.state")
    visitor.click("after ›")
    visitor.sees("toy.made")
    visitor.sees_no("toy.state")
    visitor.click("‹ before")
    visitor.sees_no("toy.made")
    for _ in range(3):
        visitor.click("after ›")
    visitor.sees("toy.state")
    assert visitor.time == 1


def test_keys(visitor):
    assert visitor.looks_squarely()
    visitor.press("ArrowRight")
    visitor.at(1)
    visitor.press("ArrowLeft")
    visitor.at(0)
    visitor.press("ArrowDown")
    visitor.at(1)
    visitor.press("ArrowUp")
    visitor.at(0)
    visitor.press("Space")
    visitor.says("Playing")
    visitor.until(lambda: visitor.time >= 2)
    visitor.press("Space")
    visitor.says("Paused")
    visitor.press("r")
    visitor.at(0)
    assert visitor.looks_squarely(), "keys for time must not turn the camera"


def test_keys_mean_the_same_after_a_click_on_a_button(visitor):
    visitor.click("▶ Play")
    visitor.says("Playing")
    visitor.press("Space")
    visitor.says("Paused")
    t = visitor.time
    visitor.page.wait_for_timeout(600)
    assert visitor.time == t
    visitor.press("ArrowRight")
    visitor.at(t + 1)


def test_keys_are_left_to_a_widget_that_has_the_focus(visitor):
    visitor.drag("Seed", 0.3)
    seed = visitor.until(lambda: visitor.value("Seed"))
    visitor.press("ArrowRight")
    visitor.until(lambda: visitor.value("Seed") == seed + 1)
    visitor.number_of("Seed").click()
    visitor.press("ArrowRight", "End", "Backspace", "r", "Space")
    visitor.until(lambda: visitor.value("Seed") == (seed + 1) // 10)
    visitor.page.wait_for_timeout(500)
    assert visitor.time == 0
    visitor.says("Paused")


def test_sliders_dragged_wildly_while_it_plays(visitor):
    rng = random.Random(4)
    visitor.type("Particles, video", 60)
    visitor.click("▶ Play")
    for control in [c for c in SLIDERS if c.group == "Tune" and c.field not in ("toy_particles", "tracker_particles")]:
        visitor.drag(control.label, *(rng.random() for _ in range(3)))
    for label, most in (("Particles, toy", 0.2), ("Particles, video", 0.05)):
        visitor.drag(label, *(most * rng.random() for _ in range(3)))
    visitor.drag("Time", *(rng.random() for _ in range(3)))
    visitor.click("↺ Reset")
    visitor.at(0)
    works(visitor)


def test_numbers_typed_wildly(visitor):
    steps(visitor, 1)
    visitor.open("Look")
    for control in SLIDERS:
        for text in (control.low, control.high if "particles" not in control.field else 70, "", "-", "1e", control.low):
            visitor.type(control.label, text)
    works(visitor)


def works(visitor):
    """The app still does what it is told, and its widgets say what it does."""
    visitor.type("Particles, toy", 31)
    visitor.type("Particles, video", 50)
    visitor.until(lambda: visitor.typed("Particles, toy") == "31")
    if visitor.page.get_by_text("Playing", exact=True).count():
        visitor.click("❚❚ Pause")
    visitor.says("Paused")
    visitor.click("↺ Reset")
    visitor.at(0)
    steps(visitor, 1)
    visitor.until(lambda: len(visitor.points("toy.state")) == 31)
    assert visitor.value("Particles, toy") == 31


def test_a_slider_that_was_dragged_shows_what_the_app_has(visitor):
    steps(visitor, 1)
    visitor.drag("Particles, toy", *[0.01 * i for i in range(12)], 0.05)
    visitor.until(lambda: len(visitor.points("toy.state")) == visitor.value("Particles, toy"))
    shown = visitor.value("Particles, toy")
    visitor.page.wait_for_timeout(1000)
    assert visitor.value("Particles, toy") == shown == len(visitor.points("toy.state"))


def test_another_world_and_a_reload_begin_anew(visitor):
    visitor.type("Particles, toy", 40)
    visitor.until(lambda: len(visitor.points("toy.newer")) == 40)
    steps(visitor, 1)
    visitor.choose("Toy world", WORLDS["linear-gaussian"].title)
    n = WORLDS["linear-gaussian"].n_particles
    visitor.until(lambda: visitor.value("Particles, toy") == n and visitor.time == 0)
    visitor.until(lambda: len(visitor.points("toy.newer")) == n)
    visitor.page.reload()
    visitor.sees("toy.newer")
    visitor.at(0)
    assert visitor.value("Particles, toy") == 24
    steps(visitor, 1)
    visitor.sees("toy.made", "tracker.close")


def test_a_second_visitor_is_another_one(visitor, visit, app):
    steps(visitor, 1)
    state = visitor.look("toy.state")
    other = visit(app, 900, 700)
    assert other.time == 0
    steps(other, 1)
    other.choose("Toy world", WORLDS["plane"].title)
    other.sees("toy.floor")
    steps(other, 1)
    assert visitor.time == 1
    assert visitor.look("toy.state") == state
    steps(visitor, 1)
    assert other.time == 1
    other.sees("toy.floor")
    other.page.close()
    steps(visitor, 1)
