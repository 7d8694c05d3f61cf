"""The rooms on the canvas, whatever its size."""

from itertools import combinations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pfviz_app.stage.layout import Rect, arrange

SIZES = st.floats(200, 4000)
PANES = st.sampled_from(["both", "toy", "tracker"])


def overlap(a: Rect, b: Rect) -> float:
    """The area that two rectangles share."""
    width = min(a.right, b.right) - max(a.x, b.x)
    height = min(a.bottom, b.bottom) - max(a.y, b.y)
    return max(width, 0.0) * max(height, 0.0)


@given(SIZES, SIZES, PANES, st.booleans(), st.booleans())
def test_rooms_lie_on_the_canvas_and_apart(width, height, pane, phone, rival):
    rooms = arrange(width, height, pane, phone, rival)
    for rect in rooms.values():
        assert rect.x >= 0 and rect.y >= 0
        assert rect.right <= width + 1e-6 and rect.bottom <= height + 1e-6
        assert rect.width >= 1 and rect.height >= 1
    for one, other in combinations(rooms.values(), 2):
        assert overlap(one, other) == 0


@given(SIZES, SIZES, PANES, st.booleans())
def test_the_room_asked_for_is_there_and_its_rival_beside_it_or_below(width, height, pane, rival):
    expected = {"toy", "tracker"} if pane == "both" else {pane}
    rooms = arrange(width, height, pane, rival=rival)
    assert set(rooms) == {(room, second) for room in expected for second in ((False, True) if rival else (False,))}
    for room in expected if rival else ():
        own, other = rooms[room, False], rooms[room, True]
        assert (own.width, own.height) == pytest.approx((other.width, other.height))
        assert own.right <= other.x or own.bottom <= other.y


@given(SIZES, SIZES)
def test_side_by_side_when_wide_one_under_the_other_when_tall(width, height):
    toy, tracker = arrange(width, height, "both").values()
    if width >= height:
        assert toy.right <= tracker.x and toy.y == tracker.y
    elif height >= 2 * width:
        assert toy.bottom <= tracker.y and toy.x == tracker.x


@given(SIZES, SIZES)
def test_both_rooms_get_as_much_and_together_most_of_the_canvas(width, height):
    toy, tracker = arrange(width, height, "both").values()
    assert (toy.width, toy.height) == pytest.approx((tracker.width, tracker.height))
    assert toy.width * toy.height + tracker.width * tracker.height >= 0.5 * width * height


@given(st.floats(300, 600), st.floats(600, 1000), PANES)
def test_on_a_phone_there_is_one_room_above_the_sheet(width, height, pane):
    rooms = arrange(width, height, pane, phone=True)
    assert set(rooms) == {("tracker" if pane == "tracker" else "toy", False)}
    (rect,) = rooms.values()
    assert rect.bottom <= max(height - 372, 0.45 * height)


@given(SIZES, SIZES, st.floats(0.1, 10))
def test_a_fitted_rectangle_has_its_aspect_and_stays_inside(width, height, aspect):
    outer = Rect(3, 5, width, height)
    inner = outer.fitted(aspect)
    assert inner.width / inner.height == pytest.approx(aspect)
    assert inner.x >= outer.x - 1e-6 and inner.right <= outer.right + 1e-6
    assert inner.y == outer.y and inner.bottom <= outer.bottom + 1e-6
    assert inner.width == pytest.approx(outer.width) or inner.height == pytest.approx(outer.height)
    assert inner.centre[0] == pytest.approx(outer.centre[0])
