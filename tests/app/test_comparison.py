"""The figures of two filters are those of their records."""

import numpy as np
import pytest
from pfviz_app.commands import Keep, Set, Step
from pfviz_app.comparison import comparison_html, figures
from pfviz_app.settings import Settings
from stand_ins import Visit

from pfviz.exact import total_variation
from pfviz.record import StepRecord

FEW = Settings(world="linear-gaussian", toy_particles=40, tracker_particles=15, rival="condensation")


@pytest.fixture(scope="module")
def picture():
    with Visit(FEW) as visit:
        yield visit.do(Step(4))


def test_figures_are_those_of_the_records(picture):
    found = {figure.label: figure for figure in figures(picture.toy, picture.rival.toy, 4, "")}
    for which, room in (("first", picture.toy), ("second", picture.rival.toy)):
        values = {label: getattr(figure, which) for label, figure in found.items()}
        assert values["error"] == pytest.approx(np.linalg.norm(room.trace[4].estimate - room.film.truth(4)))
        assert values["mean error"] == pytest.approx(room.errors[:4].mean())
        assert values["ESS"] == pytest.approx(room.trace[4].effective_sample_size)
        assert values["mean ESS"] == pytest.approx(room.effective_sample_sizes.mean())
        exact = room.exact.marginal(4)
        assert values["distance to exact"] == pytest.approx(total_variation(room.trace[4].posterior, exact))
        steps = [room.trace[t].log_evidence for t in range(1, 5)]
        assert values["log-evidence"] == pytest.approx(sum(steps))
        assert values["likelihoods"] == room.trace[4].likelihood_evaluations == 40
        assert values["ms a step"] > 0


def test_figures_that_nobody_has_are_left_out(picture):
    labels = {figure.label for figure in figures(picture.tracker, picture.rival.tracker, 4, ", px")}
    assert "distance to exact" not in labels and "error, px" in labels


def test_the_table_names_both_filters_and_says_how_to_get_one(picture):
    page = comparison_html(picture)
    assert "RB-SS-HS-SIR" in page and "CONDENSATION" in page and "nan" not in page.lower()
    with Visit(Settings(toy_particles=12, tracker_particles=15)) as visit:
        assert "Compare with" in comparison_html(visit.settled())
        assert "Step or play" in comparison_html(visit.do(Set("rival", "condensation")))
        kept = visit.do(Set("rival", "none"), Step(2), Keep(), Set("system", 2.0))
        assert "what was kept" in comparison_html(kept)


def test_only_what_was_kept_is_said_to_be_kept(picture):
    with Visit(Settings(toy_particles=12, tracker_particles=15)) as visit:
        same = visit.do(Step(), Set("rival", Settings().filter))
        assert "what was kept" not in comparison_html(same)
        other = visit.do(Keep(), Set("filter", "condensation"))
        assert "what was kept" in comparison_html(other)


def test_what_is_known_of_every_step_is_not_worked_out_again(picture, monkeypatch):
    page = comparison_html(picture)
    monkeypatch.setattr(StepRecord, "effective_sample_size", None)
    assert comparison_html(picture) == page
    assert len(picture.toy.effective_sample_sizes) == 4
