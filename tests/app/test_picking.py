"""Particles, innovations and outlines can be clicked, in every filter."""

from unittest.mock import MagicMock

import numpy as np
import pytest
from pfviz_app.commands import Set, Step
from pfviz_app.settings import Settings
from pfviz_app.shelf import Shelf
from pfviz_app.stage.composition import compose
from pfviz_app.stage.stage import Stage
from stand_ins import Visit

from pfviz.filters import FILTERS


class OnStage:
    """A stage on a page that exists only in name."""

    def __init__(self):
        client = MagicMock()
        client.camera.image_width = 1000
        self.stage = Stage(client, lambda *_: None, Shelf(2**20))
        self.stage.resize(1000, 800)

    def draw(self, picture):
        self.stage.draw(picture)
        self._marks = compose(picture, (1000, 800), False).marks

    def places(self, stem):
        """``(n, 2)``: pixels of what is drawn under names that begin with ``stem``."""
        found = [mark.properties["points"] for name, mark in self._marks.items() if name.startswith(stem)]
        return np.concatenate([points.reshape(-1, 3) for points in found])[:, :2] * [1, -1]


@pytest.mark.parametrize("filter_name", FILTERS)
@pytest.mark.parametrize("world", ["figure-1", "plane"])
def test_what_is_clicked_is_found(filter_name, world):
    shown = OnStage()
    stage = shown.stage
    settings = Settings(world=world, filter=filter_name, rival="basic-sir", toy_particles=8, tracker_particles=60)
    with Visit(settings) as visit:
        picture = visit.do(Set("toy_particles", 8), Step(2))
        shown.draw(picture)
    rows = ("toy/proposed", "toy/state" if world == "figure-1" else "toy/after/")
    for row in rows:
        for x, y in shown.places(row)[:6]:
            found = stage.pick(x, y)
            if found is None and filter_name == "innovation-sir" and row == "toy/proposed":
                continue  # no history has chosen it
            assert found is not None and (found.room, found.rival) == ("toy", False), row
            assert 0 <= found.index < 8
    x, y = shown.places("rival.toy/proposed")[0]
    assert stage.pick(x, y).rival
    x, y = shown.places("tracker/close/likely")[0]
    assert stage.pick(x, y).room == "tracker"
    assert stage.pick(-500.0, -500.0) is None


def test_an_innovation_stands_for_the_particle_that_was_made_of_it():
    shown = OnStage()
    stage = shown.stage
    with Visit(Settings(toy_particles=24, tracker_particles=20)) as visit:
        picture = visit.do(Step(1))
        shown.draw(picture)
    innovations = picture.toy.trace[1].stage("weight").particles.innovation[:, 0]
    for x, y in shown.places("toy/proposed"):
        found = stage.pick(x, y)
        assert stage.toy_place(x, y)[0] == pytest.approx(innovations[found.index], abs=0.02)


def test_a_pixel_stands_for_a_place():
    shown = OnStage()
    stage = shown.stage
    with Visit(Settings(toy_particles=24, tracker_particles=20)) as visit:
        shown.draw(visit.do(Step(1)))
    x, y = shown.places("tracker/frame/expected")[0]
    assert stage.frame_place(x, y) is not None
    assert stage.frame_place(-5.0, -5.0) is None
    assert stage.toy_place(-1e6, 0.0) == pytest.approx(-2.6)
