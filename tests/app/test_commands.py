"""Runs of commands of which only the last one matters."""

from hypothesis import given
from hypothesis import strategies as st
from pfviz_app.commands import Click, Close, Drag, Play, Reset, Resize, Seek, Set, Step, Walk, merged

COMMANDS = st.one_of(
    st.builds(Set, st.sampled_from(["system", "seed"]), st.integers(0, 3)),
    st.builds(Play, st.sampled_from([None, True, False])),
    st.builds(Step, st.integers(-1, 1)),
    st.builds(Walk, st.integers(-1, 1)),
    st.builds(Seek, st.integers(0, 3)),
    st.builds(Resize, st.integers(1, 3), st.integers(1, 3)),
    st.just(Reset()),
    st.just(Close()),
)


def test_of_a_run_of_one_slider_the_last_value_stays():
    dragged = [Set("system", value) for value in (0.5, 0.6, 0.7)]
    assert merged([*dragged, Set("seed", 3), Set("system", 2.0)]) == [
        Set("system", 0.7),
        Set("seed", 3),
        Set("system", 2.0),
    ]


def test_of_a_run_of_seeks_or_sizes_the_last_stays():
    assert merged([Seek(1), Seek(5), Resize(10, 10), Resize(20, 10), Seek(2)]) == [Seek(5), Resize(20, 10), Seek(2)]


def test_of_a_drag_the_last_place_and_the_end_stay():
    drag, end = [Drag(x, 0.0) for x in (1.0, 1.5)], Drag(1.5, 0.0, end=True)
    assert merged([*drag, end, *drag]) == [drag[1], end, drag[1]]


def test_what_counts_every_time_is_kept():
    commands = [
        Step(1),
        Step(1),
        Walk(1),
        Walk(1),
        Play(),
        Play(),
        Reset(),
        Reset(),
        Step(-1),
        Click(1, 1),
        Click(1, 2),
        Close(),
    ]
    assert merged(commands) == commands


def outcome(commands):
    """What a visitor would see: the settings, and the steps taken with each of them."""
    settings, steps, shown, size = {}, [], 0, None
    for command in commands:
        match command:
            case Set(field, value):
                settings[field] = value
            case Seek(t):
                shown = t
            case Resize(width, height):
                size = (width, height)
            case other:
                steps.append((other, dict(settings), shown))
    return settings, steps, shown, size


@given(st.lists(COMMANDS, max_size=30))
def test_merging_changes_nothing_that_lasts(commands):
    assert outcome(merged(commands)) == outcome(commands)


@given(st.lists(COMMANDS, max_size=30))
def test_no_run_is_left(commands):
    once = merged(commands)
    assert merged(once) == once
    assert len(once) <= len(commands)
