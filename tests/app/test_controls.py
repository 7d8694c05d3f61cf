"""The widgets and the session agree, whoever changed something last."""

import threading
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import pytest
from pfviz_app.commands import Reset, Seek, Set, Step
from pfviz_app.controls import Controls
from pfviz_app.settings import CONTROLS, Settings
from stand_ins import Visit

FEW = Settings(toy_particles=12, tracker_particles=15)
SOMEBODY, OURSELVES = SimpleNamespace(client=object()), SimpleNamespace(client=None)


def finish(coroutine):
    """Run a coroutine that waits for nothing, whether or not a loop is running in this thread."""
    with pytest.raises(StopIteration):
        coroutine.send(None)


class Widget:
    """An input of the page: calls back as viser's do."""

    def __init__(self, value):
        self.value = value
        self.max = None
        self._callbacks = []

    def on_update(self, callback):
        self._callbacks.append(callback)

    def call(self, event):
        for callback in self._callbacks:
            finish(callback(event))

    def moved(self, value):
        """By the visitor."""
        self.value = value
        self.call(SOMEBODY)


class Docks:
    """Controls on a page that exists only in name."""

    def __init__(self, width=1400):
        self.posted, self.idle, self.widgets = [], True, {}
        client = MagicMock()
        client.camera.image_width = width
        client.local_storage.get_item.return_value = ""
        client.gui.add_slider.side_effect = self._slider
        client.gui.add_dropdown.side_effect = self._dropdown
        client.gui.add_checkbox.side_effect = lambda label, value, **_: self._widget(label, value)
        self.controls = Controls(client, FEW, self.posted.append, lambda: self.idle, lambda: None)

    def _dropdown(self, label, options, initial_value=None, **_):
        return self._widget(label, initial_value or options[0])

    def _slider(self, label, low=0, high=1, step=1, value=0, **_):
        return self._widget(label, value)

    def _widget(self, label, value):
        return self.widgets.setdefault(label, Widget(value))


@pytest.fixture
def docks():
    return Docks()


@pytest.fixture
def visit():
    with Visit(FEW) as visit:
        yield visit


def test_every_setting_has_a_widget_that_shows_it(docks):
    for control in CONTROLS.values():
        value = getattr(FEW, control.field)
        assert docks.widgets[control.label].value == dict(control.choices).get(value, value)


def test_what_a_visitor_does_is_asked_for_in_order(docks):
    docks.widgets["System noise ×"].moved(2.0)
    docks.widgets["Filter"].moved("Basic-SIR")
    docks.widgets["System noise ×"].moved(3.0)
    docks.widgets["Time"].moved(4)
    docks.widgets["Dark colours"].moved(True)
    expected = [Set("system", 2.0), Set("filter", "basic-sir"), Set("system", 3.0), Seek(4), Set("dark", True)]
    assert docks.posted == expected


def test_what_the_session_does_is_not_asked_for_again(docks):
    for widget in docks.widgets.values():
        widget.call(OURSELVES)
    assert docks.posted == []


def test_widgets_show_what_the_session_has(docks, visit):
    docks.controls.show(visit.do(Set("filter", "basic-sir"), Set("toy_particles", 9), Step(3)))
    assert docks.widgets["Filter"].value == "Basic-SIR"
    assert docks.widgets["Particles, toy"].value == 9
    assert (docks.widgets["Time"].value, docks.widgets["Time"].max) == (3, 3)


def test_a_widget_is_not_pulled_back_while_it_is_being_dragged(docks, visit):
    slider = docks.widgets["Particles, toy"]
    slider.moved(9)
    picture = visit.do(*docks.posted)
    slider.moved(40)
    docks.idle = False
    docks.controls.show(picture)
    assert slider.value == 40
    docks.idle = True
    docks.controls.show(visit.do(docks.posted[-1]))
    assert slider.value == 40


def test_time_is_not_left_where_a_visitor_dragged_it_when_that_is_not_where_it_is(docks, visit):
    visit.do(Step(3))
    docks.widgets["Time"].moved(99)
    docks.controls.show(visit.do(*docks.posted))
    assert docks.widgets["Time"].value == 3


def test_a_wish_that_comes_while_the_widget_is_set_is_answered(docks, visit):
    docks.controls.show(visit.do(Step(3)))
    slider = docks.widgets["Time"]
    mover = threading.Thread(target=slider.moved, args=(1,))

    class Interrupted(Widget):
        def __setattr__(self, name, value):
            super().__setattr__(name, value)
            if name == "value" and mover.ident is None:
                mover.start()
                mover.join(0.2)

    slider.__class__ = Interrupted
    docks.controls.show(visit.do(Reset()))
    mover.join()
    assert docks.posted == [Seek(1)]
    docks.controls.show(visit.do(*docks.posted))
    assert slider.value == 0


def test_a_widget_is_put_right_when_what_was_asked_for_cannot_be(docks, visit):
    docks.widgets["Seed"].moved(-5)
    picture = visit.do(*docks.posted)
    docks.controls.show(picture)
    assert "Seed" in picture.message
    assert docks.widgets["Seed"].value == FEW.seed


def test_a_picture_that_is_drawn_before_a_wish_arrives_does_not_undo_it(docks, visit):
    """viser sets the widget first and calls back later, and a picture may be drawn between the two."""
    checkbox = docks.widgets["Dark colours"]
    checkbox.value = True
    docks.controls.show(visit.do(Step(1)))
    checkbox.call(SOMEBODY)
    assert docks.posted == [Set("dark", True)]


def test_what_a_visitor_has_sent_is_gone_when_they_leave(docks):
    folder = Path(docks.controls._video._folder.name)
    upload = SimpleNamespace(target=SimpleNamespace(value=SimpleNamespace(name="a.mp4", content=b"film")))
    docks.controls._video._uploaded(upload)
    assert docks.posted[-1].path.read_bytes() == b"film"
    docks.controls.close()
    assert not folder.exists()


def test_a_wish_that_is_refused_at_once_does_not_stay_on_the_page(docks):
    with Visit(FEW) as visit:
        picture = visit.settled()
        docks.controls.show(picture)
        docks.controls._post = lambda command: docks.controls.show(picture)
        docks.widgets["Seed"].moved(7)
        assert docks.widgets["Seed"].value == 0
