"""Experiments of a visitor: in the background, few at a time, and they can be stopped."""

from unittest.mock import MagicMock

import pytest
from pfviz_app import laboratory
from pfviz_app.commands import Ask, Set, Step
from pfviz_app.laboratory import Laboratory
from pfviz_app.settings import Settings
from stand_ins import Visit

from pfviz.experiments import LiveExperiment


@pytest.fixture
def bench(monkeypatch):
    """A laboratory on a page that exists only in name; its experiments run in a thread."""
    monkeypatch.setattr(laboratory, "LiveExperiment", lambda *arguments: LiveExperiment(*arguments, workers=0))
    client, posted = MagicMock(), []
    handles = {}

    def widget(label, value):
        return handles.setdefault(label, MagicMock(value=value))

    client.gui.add_dropdown.side_effect = lambda label, options, **_: widget(label, options[0])
    client.gui.add_slider.side_effect = lambda label, low, high, step, value, **_: widget(label, value)
    client.gui.add_html.side_effect = lambda content: handles.setdefault("text", MagicMock(content=content))
    client.gui.add_image.side_effect = lambda image, **_: handles.setdefault("figure", MagicMock(image=image))
    made = Laboratory(client, posted.append)
    yield made, handles
    made.close()


def run(bench, **settings):
    made, handles = bench
    with Visit(Settings(toy_particles=8, tracker_particles=15, **settings)) as visit:
        visit.do(Step(), Ask(made._run))
        live = made._live
        if live is not None:
            live.wait(60.0)
    return handles


def test_a_figure_and_sentences_come_of_the_settings_on_screen(bench):
    bench[1]["Seeds"].value = 2
    handles = run(bench, world="linear-gaussian", filter="rb-hs-sir", rival="condensation")
    text = handles["text"].content
    assert "CONDENSATION" in text and "RB-HS-SIR" in text and "particles" in text
    assert handles["figure"].image.std() > 5 and handles["figure"].visible
    assert bench[0]._live is None


def test_a_video_whose_truth_is_not_known_is_no_place_for_one(bench):
    bench[1]["Where"].value = "video"
    assert "not known" in run(bench)["text"].content


def test_no_more_than_a_few_run_at_once(bench, monkeypatch):
    monkeypatch.setattr(laboratory, "_FREE", MagicMock(acquire=lambda blocking: False))
    assert "try again" in run(bench)["text"].content


def test_what_is_cancelled_ends_and_makes_room(bench):
    made, handles = bench
    handles["Seeds"].value = 50
    with Visit(Settings(toy_particles=400, tracker_particles=15, world="linear-gaussian")) as visit:
        visit.do(Set("filter", "hs-sir"), Ask(made._run))
        live = made._live
        made.close()
        assert live.wait(60.0).state == "cancelled"
    assert laboratory._FREE.acquire(blocking=False)
    laboratory._FREE.release()
