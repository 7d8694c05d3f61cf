"""What the charts show is what is recorded."""

from dataclasses import replace
from unittest.mock import MagicMock

import numpy as np
import pytest
from pfviz_app import plots
from pfviz_app.commands import Drag, Set, Step
from pfviz_app.settings import Settings
from pfviz_app.stage.palette import LIGHT
from stand_ins import Visit

from pfviz.genealogy import ancestor_counts

FEW = Settings(world="linear-gaussian", toy_particles=40, tracker_particles=15, rival="condensation")


@pytest.fixture(scope="module")
def picture():
    with Visit(FEW) as visit:
        yield visit.do(Step(5))


def lines(drawing, picture):
    places, found = drawing(picture, LIGHT)
    assert all(len(line.values) == len(places) for line in found)
    return places, found


def test_effective_sample_sizes_are_in_percent(picture):
    times, (toy, video, *rivals) = lines(plots._sizes, picture)
    np.testing.assert_allclose(toy.values[:5], 100 * picture.toy.effective_sample_sizes / 40)
    np.testing.assert_allclose(video.values[:5], 100 * picture.tracker.effective_sample_sizes / 15)
    assert np.isnan(toy.values[5:]).all() and times[0] == 1
    assert {line.colour for line in rivals} == {LIGHT.rival}


def test_the_errors_of_the_video_have_an_axis_of_their_own(picture):
    _, (toy, video, *_) = lines(plots._errors, picture)
    assert (toy.scale, video.scale) == ("y", "px")
    np.testing.assert_allclose(video.values[:5], picture.tracker.errors)


def test_the_evidence_is_drawn_with_the_exact_one(picture):
    _, (own, rival, exact) = lines(plots._toy_evidence, picture)
    np.testing.assert_allclose(own.values[:5], picture.toy.log_evidences)
    np.testing.assert_allclose(rival.values[:5], picture.rival.toy.log_evidences)
    np.testing.assert_allclose(exact.values[4], sum(picture.toy.exact.log_evidence(t) for t in range(1, 6)))
    assert abs(own.values[4] - exact.values[4]) < 5


def test_the_heaviest_have_at_least_their_share_of_the_weight(picture):
    shares, (even, *rest) = lines(plots._lorenz, picture)
    np.testing.assert_allclose(even.values, shares)
    for line in rest:
        assert (np.diff(line.values) >= -1e-9).all() and (line.values >= shares - 1e-9).all()
        assert line.values[-1] == pytest.approx(100.0)
    weights = np.sort(picture.toy.trace[5].stage("weight").particles.weights)[::-1]
    assert rest[0].values[25] == pytest.approx(100 * weights[:20].sum()), "half of the particles"


def test_ancestors_grow_fewer_backwards(picture):
    _, (toy, *_) = lines(plots._ancestors, picture)
    np.testing.assert_array_equal(toy.values[:6], ancestor_counts(picture.toy.trace, 5, 5))
    assert (np.diff(toy.values[:6]) <= 0).all()


def test_a_chart_is_sent_only_when_something_has_changed(picture):
    client, sent = MagicMock(), []
    client.gui.add_uplot.side_effect = lambda *_, **__: sent.append(MagicMock()) or sent[-1]
    charts = plots.Plots(client, MagicMock())
    charts.draw(picture)
    first = [chart.data for chart in sent]
    charts.draw(picture)
    assert [chart.data for chart in sent] == first
    assert len(sent) == 6
    assert all(len(chart.series) == len(chart.data) for chart in sent)


def test_the_charts_follow_what_is_dragged_and_the_pause():
    client, sent = MagicMock(), []
    client.gui.add_uplot.side_effect = lambda *_, **__: sent.append(MagicMock()) or sent[-1]
    charts = plots.Plots(client, MagicMock())
    with Visit(replace(FEW, rival="none")) as visit:
        picture = visit.do(Step(5))
        charts.draw(replace(picture, playing=True))
        assert all(np.isnan(line).all() for line in sent[5].data[1:])
        charts.draw(picture)
        assert sent[5].data[1][0] > 0, "ancestors are counted when it stops"
        before = sent[1].data[1][4]
        charts.draw(visit.do(Drag(4.0, 0.0)))
        assert sent[1].data[1][4] == picture.toy.errors[4] != before


def test_no_curve_is_ever_without_its_numbers(picture):
    """uPlot trips over a series that has no data yet, or no longer: there are always as many."""
    client, counts = MagicMock(), set()

    class Chart:
        def __init__(self, data, series, **_):
            self.data, self.series = data, series

        def __setattr__(self, name, value):
            self.__dict__[name] = value
            if name in ("data", "series"):
                counts.add(len(value))

    client.gui.add_uplot.side_effect = Chart
    charts = plots.Plots(client, MagicMock())
    with Visit(replace(FEW, rival="none")) as visit:
        alone = visit.do(Step(2))
        for shown in (alone, picture, alone, picture):
            charts.draw(shown)
    assert len(counts) == 1


def test_before_the_first_step_there_is_nothing_to_draw():
    with Visit(Settings(toy_particles=12, tracker_particles=15)) as visit:
        picture = visit.do(Set("arrows", 3))
        for drawing in (plots._sizes, plots._errors, plots._toy_evidence, plots._lorenz, plots._ancestors):
            _, found = lines(drawing, picture)
            assert all(np.isnan(line.values).all() for line in found if line.label != "even")
