"""Experiments of a visitor: in the background, few at a time, and they can be stopped."""

from unittest.mock import MagicMock

import pytest
from pfviz_app import laboratory
from pfviz_app.commands import Ask, Set, Step
from pfviz_app.laboratory import Laboratory
from pfviz_app.settings import Settings
from stand_ins import Visit

from pfviz.experiments import LiveExperiment, Progress

pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")


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
    assert "scenes alone" in run(bench)["text"].content


def test_no_more_than_a_few_run_at_once(bench, monkeypatch):
    monkeypatch.setattr(laboratory, "_FREE", MagicMock(acquire=lambda blocking: False))
    assert "try again" in run(bench)["text"].content


def test_an_experiment_that_breaks_makes_room_and_says_why(bench, monkeypatch):
    monkeypatch.setattr(LiveExperiment, "_collect", lambda *_: 1 / 0)
    assert "division" in run(bench)["text"].content
    assert_over(bench[0])


def test_what_cannot_be_shown_makes_room_too(bench, monkeypatch):
    monkeypatch.setattr(laboratory, "pixels_of", lambda figure: 1 / 0)
    bench[1]["Seeds"].value = 2
    run(bench, world="linear-gaussian", filter="rb-hs-sir", rival="condensation")
    assert_over(bench[0])


def a_picture():
    with Visit(Settings(toy_particles=8, tracker_particles=15)) as visit:
        return visit.settled()


def test_what_is_over_at_once_can_be_followed_by_another(bench, monkeypatch):
    made, picture, live = bench[0], a_picture(), MagicMock()
    monkeypatch.setattr(laboratory, "LiveExperiment", lambda *given: given[-1](Progress((), 0, 0, "finished")) or live)
    made._run(picture)
    assert_over(made)
    monkeypatch.setattr(laboratory, "LiveExperiment", lambda *_: live)
    made._run(picture)
    monkeypatch.setattr(laboratory, "LiveExperiment", None)
    made._run(picture)
    assert made._live is live, "one at a time"
    made._progressed(Progress((), 0, 0, "cancelled"))
    assert_over(made)


@pytest.mark.parametrize(("asked", "wanted"), [(10**9, 50), (-3, 2), (7, 7)])
def test_no_more_seeds_than_the_slider_allows(bench, monkeypatch, asked, wanted):
    made, handles = bench
    handles["Seeds"].value, found = asked, []
    monkeypatch.setattr(laboratory, "LiveExperiment", lambda _, seeds, tell: found.append(seeds))
    made._run(a_picture())
    made._progressed(Progress((), 0, 0, "finished"))
    assert found == [wanted]


def test_who_has_left_begins_nothing(bench, monkeypatch):
    monkeypatch.setattr(laboratory, "LiveExperiment", None)
    bench[0].close()
    bench[0]._run(a_picture())
    assert_over(bench[0])


def assert_over(made):
    assert made._live is None and not made._running
    for _ in range(laboratory._AT_ONCE):
        assert laboratory._FREE.acquire(blocking=False)
    laboratory._FREE.release(laboratory._AT_ONCE)


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
