"""Particles, innovations and outlines can be clicked, in every filter."""

from unittest.mock import MagicMock

import numpy as np
import pytest
from pfviz_app.commands import Set, Step
from pfviz_app.settings import Settings
from pfviz_app.stage.board import Board
from pfviz_app.stage.stage import Stage
from pfviz_app.stage.tracker import TrackerStage
from stand_ins import Visit

from pfviz.filters import FILTERS


@pytest.fixture
def stage(monkeypatch):
    """A stage on a page that exists only in name; ``drawn`` has the points of the last picture."""
    client, drawn = MagicMock(), {}
    client.camera.image_width = 1000
    monkeypatch.setattr(
        Board, "_draw", lambda self, name, create, **props: drawn.setdefault(self.scope + name, props.get("points"))
    )
    made = Stage(client, lambda *_: None)
    made.resize(1000, 800)
    return made, drawn


def places(drawn, stem):
    """``(n, 2)``: pixels of what is drawn under names that begin with ``stem``."""
    found = [np.reshape(points, (-1, 3)) for name, points in drawn.items() if name.startswith(stem)]
    return np.concatenate(found)[:, :2] * [1, -1]


@pytest.mark.parametrize("filter_name", FILTERS)
@pytest.mark.parametrize("world", ["figure-1", "plane"])
def test_what_is_clicked_is_found(stage, filter_name, world):
    stage, drawn = stage
    settings = Settings(world=world, filter=filter_name, rival="basic-sir", toy_particles=8, tracker_particles=60)
    with Visit(settings) as visit:
        picture = visit.do(Set("toy_particles", 8), Step(2))
        stage.draw(picture)
    rows = ("toy/proposed", "toy/state" if world == "figure-1" else "toy/after/")
    for row in rows:
        for x, y in places(drawn, row)[:6]:
            found = stage.pick(x, y)
            if found is None and filter_name == "innovation-sir" and row == "toy/proposed":
                continue  # no history has chosen it
            assert found is not None and (found.room, found.rival) == ("toy", False), row
            assert 0 <= found.index < 8
    x, y = places(drawn, "rival.toy/proposed")[0]
    assert stage.pick(x, y).rival
    x, y = places(drawn, "tracker/close/likely")[0]
    assert stage.pick(x, y).room == "tracker"
    assert stage.pick(-500.0, -500.0) is None


def test_an_innovation_stands_for_the_particle_that_was_made_of_it(stage):
    stage, drawn = stage
    with Visit(Settings(toy_particles=24, tracker_particles=20)) as visit:
        picture = visit.do(Step(1))
        stage.draw(picture)
    innovations = picture.toy.trace[1].stage("weight").particles.innovation[:, 0]
    for x, y in places(drawn, "toy/proposed"):
        found = stage.pick(x, y)
        assert stage.toy_place(x, y)[0] == pytest.approx(innovations[found.index], abs=0.02)


def test_a_pixel_stands_for_a_place(stage):
    stage, drawn = stage
    with Visit(Settings(toy_particles=24, tracker_particles=20)) as visit:
        stage.draw(visit.do(Step(1)))
    x, y = places(drawn, "tracker/frame/expected")[0]
    assert stage.frame_place(x, y) is not None
    assert stage.frame_place(-5.0, -5.0) is None
    assert stage.toy_place(-1e6, 0.0) == pytest.approx(-2.6)


def test_another_frame_is_not_taken_for_one_whose_place_in_memory_it_has():
    drawing = TrackerStage(MagicMock())
    for shade in (10, 200, 90):
        assert (drawing._shown(np.full((40, 60, 3), shade, np.uint8)) == shade).all()
