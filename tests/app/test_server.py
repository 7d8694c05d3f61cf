"""A visitor's screen and session, on a page that exists only in name."""

import signal
import time
from unittest.mock import DEFAULT, MagicMock

import pytest
from pfviz_app import server
from pfviz_app.commands import Ask, Seek, Step
from pfviz_app.server import App, Shelves, Visitor
from pfviz_app.settings import Settings
from stand_ins import DiscVideo, disc_setup

FEW = Settings(toy_particles=12, tracker_particles=15)


@pytest.fixture
def controls(monkeypatch):
    made = MagicMock()
    monkeypatch.setattr(server, "Controls", made)
    return made


def page():
    client = MagicMock()
    client.camera.image_width, client.camera.image_height = 1000, 800
    return client


def wait_until(condition):
    patience = time.monotonic() + 20.0
    while not condition():
        assert time.monotonic() < patience
        time.sleep(0.01)


def messages(controls):
    return [call.args[0].message for call in controls.return_value.show.call_args_list]


def test_a_visitor_for_whom_no_controls_can_be_made_leaves_no_open_video(controls):
    video = DiscVideo()
    controls.side_effect = RuntimeError("gone")
    with pytest.raises(RuntimeError, match="gone"):
        Visitor(page(), FEW, disc_setup(lambda: video), Shelves())
    assert video.closed == 1


def test_where_the_picture_cannot_be_drawn_the_docks_say_why(controls):
    video = DiscVideo()
    visitor = Visitor(page(), FEW, disc_setup(lambda: video), Shelves())
    done = []
    visitor.session.post(Step(3))
    visitor.session.post(Ask(lambda _: setattr(video, "broken", 0)))
    visitor.session.post(Seek(1))
    wait_until(lambda: any("on fire" in message for message in messages(controls)))
    visitor.session.post(Ask(lambda _: setattr(video, "broken", None)))
    visitor.session.post(Step(1))
    visitor.session.post(Ask(done.append))
    wait_until(lambda: done)
    assert (done[0].t, done[0].message) == (2, "")
    visitor.close()


def test_a_canvas_that_the_docks_have_made_narrower_is_drawn_for(controls):
    client = page()
    client.camera.image_width, client.camera.image_height = 1200, 600

    def dock(*_):
        client.camera.image_width = 552
        return DEFAULT

    controls.side_effect = dock
    visitor = Visitor(client, FEW, disc_setup(), Shelves())
    wait_until(lambda: visitor._stage._size == (552, 600))
    visitor.close()


def test_the_session_ends_before_what_it_draws_on(controls):
    visitor = Visitor(page(), FEW, disc_setup(), Shelves())
    alive = []
    controls.return_value.close.side_effect = lambda: alive.append(visitor.session.alive)
    visitor.close()
    assert alive == [False]


def test_a_server_that_stops_closes_docks_and_sessions(controls, monkeypatch):
    monkeypatch.setattr(server.viser, "ViserServer", MagicMock())
    app, client = App("127.0.0.1", 0, FEW, disc_setup()), page()
    app.server.get_clients.return_value = {client.client_id: client}
    app._enter(client)
    session = app.sessions[0]
    app.stop()
    assert not session.alive
    controls.return_value.close.assert_called_once_with()


def test_who_reads_that_it_runs_may_end_it_at_once(monkeypatch):
    apps, before = MagicMock(), {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    monkeypatch.setattr(server, "App", apps)
    monkeypatch.setattr(server, "warm_up", lambda: None)
    monkeypatch.setattr(server, "print", lambda *_, **__: signal.raise_signal(signal.SIGINT), raising=False)
    try:
        server.run_app(FEW, disc_setup(), "127.0.0.1", None, open_browser=False)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    apps.return_value.stop.assert_called_once_with()
