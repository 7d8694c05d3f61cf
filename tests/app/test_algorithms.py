"""What the left dock says of a filter must be what the filter does, in its order."""

import html
import re

import pytest
from pfviz_app.algorithms import ALGORITHMS, algorithm
from pfviz_app.explanations import explanation

from pfviz.filters import FILTERS, make_filter
from pfviz.running import run
from pfviz.worlds import get_world


@pytest.mark.parametrize("name", FILTERS)
def test_the_lines_are_the_stages_in_order(name):
    world = get_world("figure-1")
    record = next(run(make_filter(name, 20), world.model, world.record(0, 1).observations))
    assert [line.kind for line in ALGORITHMS[name]] == [*(stage.kind for stage in record.stages), None]


@pytest.mark.parametrize("name", FILTERS)
def test_exactly_the_line_of_the_stage_is_marked(name):
    lines = ALGORITHMS[name]
    for stage in (*range(len(lines) - 1), None):
        marked = re.findall(r"font-weight:600\">([^<]*)<", html.unescape(algorithm(name, stage, dark=False)))
        assert marked == [lines[-1 if stage is None else stage].words]
        assert algorithm(name, stage, dark=False).count("<math") == len(lines)


@pytest.mark.parametrize("name", FILTERS)
def test_every_filter_is_explained(name):
    text = explanation(name)
    assert FILTERS[name].title in text and "Predict" in text and len(text) > 120
