"""Every setting takes what its control offers and refuses all else, saying so."""

import math
from dataclasses import fields

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pfviz_app.settings import CONTROLS, Settings

from pfviz.filters import FILTERS
from pfviz.worlds import WORLDS

SLIDERS = [control for control in CONTROLS.values() if control.kind == "slider"]
CHOICES = [control for control in CONTROLS.values() if control.kind == "choice"]
SWITCHES = [control for control in CONTROLS.values() if control.kind == "switch"]
WHOLE = [control for control in SLIDERS if isinstance(getattr(Settings(), control.field), int)]


def test_every_setting_has_a_control_and_its_default_is_in_range():
    assert {field.name for field in fields(Settings)} == set(CONTROLS)
    for field in CONTROLS:
        assert Settings().with_value(field, getattr(Settings(), field)) == Settings()


@pytest.mark.parametrize("control", SLIDERS, ids=lambda control: control.field)
@given(share=st.floats(0.0, 1.0))
def test_a_slider_takes_everything_in_its_range(control, share):
    value = control.low + share * (control.high - control.low)
    taken = getattr(Settings().with_value(control.field, value), control.field)
    if control in WHOLE:
        assert isinstance(taken, int) and abs(taken - value) <= 0.5
    else:
        assert taken == value


@pytest.mark.parametrize("control", SLIDERS, ids=lambda control: control.field)
@given(outside=st.floats(min_value=1e-3, exclude_min=True, allow_nan=False))
def test_a_slider_refuses_what_lies_outside(control, outside):
    for value in (control.low - outside, control.high + outside):
        with pytest.raises(ValueError) as error:
            Settings().with_value(control.field, value)
        message = str(error.value)
        assert control.label in message
        assert repr(value) in message
        assert f"{control.low:g} to {control.high:g}" in message


@pytest.mark.parametrize("control", SLIDERS, ids=lambda control: control.field)
@pytest.mark.parametrize("value", ["many", None, [], math.nan, math.inf, ""])
def test_a_slider_refuses_what_is_no_number(control, value):
    with pytest.raises(ValueError, match=control.label) as error:
        Settings().with_value(control.field, value)
    assert repr(value) in str(error.value)


@pytest.mark.parametrize("control", CHOICES, ids=lambda control: control.field)
def test_a_choice_takes_its_names_only(control):
    for name, label in control.choices:
        assert getattr(Settings().with_value(control.field, name), control.field) == name
        if label != name:
            with pytest.raises(ValueError, match=control.label):
                Settings().with_value(control.field, label)
    for wrong in ("nothing like it", None, 3, []):
        with pytest.raises(ValueError, match=control.label) as error:
            Settings().with_value(control.field, wrong)
        assert all(name in str(error.value) for name, _ in control.choices)


def test_the_choices_are_those_of_the_library():
    assert [name for name, _ in CONTROLS["filter"].choices] == list(FILTERS)
    assert [name for name, _ in CONTROLS["world"].choices] == list(WORLDS)


@pytest.mark.parametrize("control", CHOICES, ids=lambda control: control.field)
def test_labels_tell_the_choices_apart(control):
    labels = [label for _, label in control.choices]
    assert len(set(labels)) == len(labels)


@pytest.mark.parametrize("control", SWITCHES, ids=lambda control: control.field)
def test_a_switch_is_on_or_off(control):
    for value in (True, False):
        assert getattr(Settings().with_value(control.field, value), control.field) is value


@given(field=st.text().filter(lambda text: text not in CONTROLS))
def test_an_unknown_setting_is_refused_by_name(field):
    with pytest.raises(ValueError) as error:
        Settings().with_value(field, 1)
    assert repr(field) in str(error.value)


def test_settings_are_values():
    changed = Settings().with_value("seed", 7)
    assert changed.seed == 7
    assert Settings().seed == 0
    assert changed == Settings(seed=7)
