"""A share code brings back exactly what was shared, and nothing else is taken for one."""

import base64
import json
import zlib
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pfviz_app.films import Start
from pfviz_app.settings import RUNNING, SettingError, Settings
from pfviz_app.share import Shared, changes, decode, encode

from pfviz.filters import FILTERS
from pfviz.worlds import WORLDS

SETTINGS = st.builds(
    Settings,
    world=st.sampled_from(sorted(WORLDS)),
    filter=st.sampled_from(sorted(FILTERS)),
    rival=st.sampled_from(["none", "itself", *sorted(FILTERS)]),
    toy_particles=st.integers(1, 2000),
    system=st.floats(0.1, 4.0),
    seed=st.integers(0, 999),
    dark=st.booleans(),
)
STEPS = st.lists(st.tuples(st.integers(0, 2000), st.sampled_from(sorted(FILTERS)), st.floats(0.1, 4.0)), max_size=6)
PLACES = st.floats(-5.0, 5.0).map(lambda x: round(x, 4))


def changed(settings, steps):
    return tuple((t, replace(settings, filter=name, system=noise)) for t, name, noise in sorted(steps))


def code_of(values):
    return "pf2-" + base64.urlsafe_b64encode(zlib.compress(json.dumps(values).encode())).decode()


@given(SETTINGS, st.integers(0, 2000), st.one_of(st.none(), st.integers(0, 6)))
def test_a_code_brings_back_settings_time_and_stage(settings, t, stage):
    code = encode(Shared(settings, t, stage))
    assert code.startswith("pf2-") and len(code) < 400
    assert decode(code) == Shared(settings, t, stage)


@given(SETTINGS, STEPS, STEPS, st.dictionaries(st.integers(1, 2000), st.tuples(PLACES), max_size=5))
def test_a_code_brings_back_what_was_changed_on_the_way(settings, own, rival, held):
    shared = Shared(settings, 2000, None, changed(settings, own), changed(settings, rival), held)
    back = decode(encode(shared))
    assert back.held == held
    assert back.rival_changes == shared.rival_changes
    for t in (1, 500, 2000):
        assert all(getattr(back.at(t), name) == getattr(shared.at(t), name) for name in RUNNING)


def test_what_is_followed_in_the_video_is_in_the_code():
    for start in (Start(7, ((1.0, 2.0), (30.5, 40.0))), Start(0, ((1.0, 2.0), (30.5, 40.0), (5.0, 60.1)))):
        assert decode(encode(Shared(Settings(), start=start))).start == start


@given(st.sampled_from(["scene:twin", "holiday.mp4", "Füße und Köpfe.mov", r"a\x1b.mp4"]))
def test_the_video_is_in_the_code(video):
    assert decode(encode(Shared(Settings(), video=video))).video == video


def test_codes_made_before_they_named_the_video_open_as_they_did():
    before = decode("pf2-eNqrVipRsjLRUSouSSwCsqINdKJN9UxNdQz1jGJ1oo31THRMzfUMYmNrAefHCrw")
    assert before == decode(code_of({"t": 4, "start": [0, [5.55, 1.2], [3.4, 57.0]]})) and before.video is None
    for video in ("scene:twin", "holiday.mp4"):
        assert before.brought_to(video) == (before, "")


def test_what_is_marked_in_one_video_is_not_looked_for_in_another():
    shared = Shared(Settings(seed=7), 12, held={3: (1.5,)}, start=Start(7, ((1.0, 2.0), (30.5, 40.0))), video="a.mp4")
    assert shared.brought_to("a.mp4") == (shared, "")
    elsewhere, note = shared.brought_to("scene:twin")
    assert elsewhere == replace(shared, start=None)
    assert "a.mp4" in note and "scene:twin" in note


def test_changes_are_told_where_they_are():
    one, other = Settings(), Settings(system=2.0)
    assert changes([one, one, replace(one, dark=True), other, one]) == ((1, one), (4, other), (5, one))
    assert changes([]) == ()


@given(st.text(max_size=60))
def test_what_is_no_share_code_is_refused_in_words(text):
    try:
        decode(text)
    except SettingError as error:
        assert "share code" in str(error)
    else:
        assert text.strip().startswith("pf2-")


@pytest.mark.parametrize(
    "values",
    [
        {"t": 5000},
        {"t": "x"},
        {"t": True, "stage": -1},
        {"stage": 99},
        {"system": 77.0},
        {"system": 10**400},
        {"held": [[1, 10**400]]},
        {"held": [[1, float("nan")]]},
        {"t": True},
        {"world": "x"},
        {"nothing": 1},
        {"changes": [[1]]},
        {"changes": 5},
        {"changes": [[1, {"system": -1}]]},
        {"changes": [[1, [2]]]},
        {"rivals": [[9999, {}]]},
        {"held": [[1, "x"]]},
        {"held": [[1, 1e300]]},
        {"held": 5},
        {"held": [[1, 2, 3, 4]]},
        {"start": []},
        {"start": 3},
        {"start": [0, [1, 2], "x", [1]]},
        {"start": [-1, [1, 2], [3, 4]]},
        {"video": 7},
        {"video": "a\nb.mp4"},
        {"video": "x" * 500},
        [1, 2],
        7,
    ],
    ids=str,
)
def test_what_asks_for_something_there_is_not_is_refused(values):
    with pytest.raises(SettingError, match=r"share code|expected|unknown setting"):
        decode(code_of(values))


def test_a_code_that_is_cut_short_or_unpacks_without_end_is_refused():
    code = encode(Shared(Settings(world="plane", seed=7), 12))
    bomb = "pf2-" + base64.urlsafe_b64encode(zlib.compress(b" " * 10**7 + b"{}")).decode()
    for bad in (code[:-4], bomb, "", "pf2-", "pf2-!!!!"):
        with pytest.raises(SettingError, match="share code"):
            decode(bad)
