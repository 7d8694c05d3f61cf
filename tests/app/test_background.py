"""What takes long is made beside the session, can be given up, and comes one at a time."""

import threading
from unittest.mock import MagicMock

import pytest
from pfviz_app import background, exports
from pfviz_app.background import Background
from pfviz_app.commands import Ask, Step
from pfviz_app.controls import Controls
from pfviz_app.settings import Settings
from pfviz_app.sharing import Sharing
from pfviz_app.takeaways import SLOW_TAKEAWAYS
from stand_ins import DiscVideo, Visit, disc_setup

FEW = Settings(toy_particles=12, tracker_particles=15)
(VIDEO,) = SLOW_TAKEAWAYS


@pytest.fixture
def folder():
    """The folder of a visitor who wants the video; ``buttons`` has what is asked of its buttons."""
    client = MagicMock()
    client.local_storage.get_item.return_value = ""
    made = Sharing(client, lambda _: None)
    made._what.value = VIDEO
    yield made
    made.close()
    made._background.join(30.0)


@pytest.fixture
def gate(monkeypatch):
    """While it is not open no frame is written."""
    opened, write = threading.Event(), exports.write_video
    monkeypatch.setattr(exports, "write_video", lambda *given: opened.wait(30.0) and write(*given))
    return opened


def sent(folder):
    return [call.args[0] for call in folder._client.send_file_download.call_args_list]


def notices(folder):
    return [call.args for call in folder._client.add_notification.call_args_list]


def test_the_session_goes_on_while_a_video_is_made(folder, gate):
    with Visit(FEW) as visit:
        visit.do(Step(3), Ask(folder._take))
        assert visit.do(Step(2)).t == 5, "nothing waits for it"
        assert sent(folder) == []
        gate.set()
        folder._background.join(30.0)
    assert sent(folder) == ["pfviz.mp4"]
    folder._client.add_notification.return_value.remove.assert_called_once_with()


def test_one_at_a_time(folder, gate):
    with Visit(FEW) as visit:
        assert visit.do(Step(), Ask(folder._take)).message == ""
        assert "still being made" in visit.do(Ask(folder._take)).message
        gate.set()
        folder._background.join(30.0)
        assert visit.do(Step(), Ask(folder._take)).message == ""
        folder._background.join(30.0)
    assert len(sent(folder)) == 2


def test_before_the_first_step_there_is_no_video(folder):
    with Visit(FEW) as visit:
        assert "take a step first" in visit.do(Ask(folder._take)).message
    assert notices(folder) == []


def test_who_leaves_gets_none_and_others_get_theirs(folder, gate):
    with Visit(FEW) as visit:
        visit.do(Step(3), Ask(folder._take))
        folder.close()
        gate.set()
        folder._background.join(30.0)
        assert sent(folder) == [] and len(notices(folder)) == 1
        visit.do(Ask(folder._take))
        folder._background.join(30.0)
    assert sent(folder) == ["pfviz.mp4"]


def test_what_waits_for_others_can_be_given_up(folder):
    with background._ROOM, Visit(FEW) as visit:
        visit.do(Step(), Ask(folder._take))
        folder._background.join(0.5)
        assert sent(folder) == []
        folder._background.cancel()
        folder._background.join(30.0)
    assert sent(folder) == [] and not folder._background._thread.is_alive()


def test_where_it_cannot_be_made_it_is_said(folder):
    video = DiscVideo()
    with Visit(FEW, disc_setup(lambda: video)) as visit:
        visit.do(Step(3))
        video.broken = 1
        visit.do(Ask(folder._take))
        folder._background.join(30.0)
        assert notices(folder)[-1] == ("pfviz.mp4 cannot be made", "disc: the disc drive is on fire")
        video.broken = None
        visit.do(Ask(folder._take))
        folder._background.join(30.0)
    assert sent(folder) == ["pfviz.mp4"]


def test_how_far_it_is_and_that_it_is_made_are_shown(monkeypatch):
    monkeypatch.setattr(background, "_PERIOD", -1.0)
    client, busy, bodies = MagicMock(), [], []
    made = Background(client, busy.append)

    def make(tell):
        for share in (0.25, 1.0):
            tell(share)
            bodies.append(client.add_notification.return_value.body)
        return b"film"

    made.begin("film.mp4", make)
    made.join(30.0)
    assert bodies == ["25%", "100%"] and busy == [True, False]
    client.send_file_download.assert_called_once_with("film.mp4", b"film", save_immediately=True)


def test_leaving_gives_it_up():
    docks = MagicMock()
    Controls.close(docks)
    docks._sharing.close.assert_called_once_with()
