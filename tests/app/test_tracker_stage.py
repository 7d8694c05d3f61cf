"""What is drawn over the video lies where the state says."""

from unittest.mock import MagicMock

import numpy as np
import pytest
from pfviz_app.served import prepare_video
from pfviz_app.settings import Settings
from pfviz_app.stage.layout import Rect
from pfviz_app.stage.palette import LIGHT
from pfviz_app.stage.seen import After
from pfviz_app.stage.tracker import TrackerStage, Window
from stand_ins import DISC_BOX, SIZE, Visit, disc_frame

from pfviz.particles import ParticleSet
from pfviz.vision.tracker import learn_tracker

STATES = {
    "similarity": [22.0, 36.0, 0.7, 0.2],
    "affine": [22.0, 36.0, 0.7, 0.2, 0.5, -0.3],
}


@pytest.mark.parametrize("shape", STATES)
def test_search_normals_stand_at_right_angles_on_the_outline(shape):
    model, board = learn_tracker(disc_frame(0), DISC_BOX, shape=shape), MagicMock()
    particles = ParticleSet(np.array([[STATES[shape]]]), np.zeros(1))
    after = After(particles, np.array([-1]), np.ones(1), np.array([0]))
    window = Window(Rect(5, 7, 3.0 * SIZE[0], 3.0 * SIZE[1]), Rect(0, 0, *SIZE))
    TrackerStage(board)._normals(after, 0, model, model.observe(disc_frame(0)), window)
    normals = next(call.args[1] for call in board.segments.call_args_list if call.args[0].endswith("normals"))
    outline = window(model.contour.outlines(particles.innovation, per_segment=100)[0])
    assert len(normals) == len(model.contour.points)
    for inner, outer in normals:
        middle, along = 0.5 * (inner + outer), outer - inner
        nearest = int(np.argmin(np.linalg.norm(outline - middle, axis=1)))
        tangent = outline[(nearest + 1) % len(outline)] - outline[nearest - 1]
        assert np.linalg.norm(outline[nearest] - middle) < 0.5, "it stands on the outline"
        assert abs(along @ tangent) < 0.02 * np.linalg.norm(along) * np.linalg.norm(tangent), "at a right angle"
        assert along @ (middle - outline.mean(axis=0)) > 0, "and points outward"


@pytest.mark.parametrize("learn_frame", [0, 5])
def test_before_the_first_step_an_object_is_outlined_only_where_it_is_known_to_be(learn_frame):
    setup, board = prepare_video("scene:twin", None, 0, learn_frame=learn_frame), MagicMock()
    with Visit(Settings(), setup) as visit:
        picture = visit.settled()
        TrackerStage(board).draw(Rect(0, 0, 400, 600), picture, LIGHT)
    drawn = [call.args[0] for call in board.polyline.call_args_list]
    assert ("tracker/frame/expected" in drawn) == (learn_frame == 0)
