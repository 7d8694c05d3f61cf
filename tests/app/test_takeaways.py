"""Everything that is offered to be taken along can be taken, or says why not."""

import ast
import io
import json

import cv2
import numpy as np
import pytest
from pfviz_app.commands import Keep, Seek, Set, Step
from pfviz_app.settings import Settings
from pfviz_app.takeaways import SLOW_TAKEAWAYS, TAKEAWAYS
from stand_ins import Visit

FEW = Settings(toy_particles=12, tracker_particles=15)


@pytest.fixture(scope="module")
def picture():
    """After a branch, so that there are two lanes."""
    with Visit(FEW) as visit:
        visit.do(Step(3))
        yield visit.do(Keep(), Set("system", 2.0), Step(2))


@pytest.mark.parametrize("title", [title for title in TAKEAWAYS if title != "Python script, video"])
def test_every_file_is_what_its_name_says(picture, title):
    name, make = TAKEAWAYS[title]
    content = make(picture)
    match name.rsplit(".")[-1]:
        case "png":
            assert cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR).std() > 5
        case "svg":
            assert b"<svg" in content[:1000]
        case "pdf":
            assert content.startswith(b"%PDF")
        case "py":
            ast.parse(content.decode())
        case "json":
            json.loads(content)
        case "csv":
            rows = np.genfromtxt(io.BytesIO(content), delimiter=",", names=True, dtype=None, encoding="utf-8")
            assert set(rows["t"]) == set(range(1, picture.last + 1))


@pytest.mark.parametrize("title", SLOW_TAKEAWAYS)
def test_what_takes_long_is_of_what_was_recorded_when_it_was_asked_for(title, tmp_path):
    told, (name, maker) = [], SLOW_TAKEAWAYS[title]
    with Visit(FEW) as visit:
        make = maker(visit.do(Step(5)))
        assert visit.do(Seek(2), Set("system", 2.0)).last == 2
        content = make(told.append)
    (tmp_path / name).write_bytes(content)
    assert cv2.VideoCapture(str(tmp_path / name)).get(cv2.CAP_PROP_FRAME_COUNT) == 5
    assert told == pytest.approx([0.2, 0.4, 0.6, 0.8, 1.0])


def test_what_is_not_there_yet_is_said():
    with Visit(FEW) as visit:
        start = visit.settled()
        for title, (name, make) in (TAKEAWAYS | SLOW_TAKEAWAYS).items():
            if "script" in title or name.endswith("json"):
                continue
            with pytest.raises(ValueError, match="step first"):
                make(start)


def test_a_video_that_was_sent_has_no_script(picture):
    with pytest.raises(ValueError, match="not on the server"):
        TAKEAWAYS["Python script, video"][1](picture)
