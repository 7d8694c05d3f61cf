"""What is sent beyond the limit is dropped as it comes in."""

from types import SimpleNamespace
from unittest.mock import MagicMock

from pfviz_app.uploads import guard_uploads, kept_upload
from viser._messages import FileTransferPart, FileTransferStartUpload


class Connection:
    """Passes messages to those who want them."""

    def __init__(self):
        self._handlers = {}

    def register_handler(self, kind, handler):
        self._handlers.setdefault(kind, []).append(handler)

    def receive(self, message):
        for handler in self._handlers[type(message)]:
            handler(0, message)


def guarded(most):
    client = MagicMock()
    client._websock_connection = Connection()
    client.gui = SimpleNamespace(_current_file_upload_states={"a": {}, "b": {}})
    guard_uploads(client, most)
    return client, client._websock_connection, client.gui._current_file_upload_states


def start(uuid, size):
    return FileTransferStartUpload("button", uuid, "film.mp4", "video/mp4", 9, size)


def test_what_is_announced_too_large_is_not_begun():
    client, connection, states = guarded(100)
    connection.receive(start("a", 101))
    connection.receive(start("b", 100))
    assert set(states) == {"b"}
    client.add_notification.assert_called_once()


def test_what_turns_out_too_large_is_dropped_whatever_was_announced():
    client, connection, states = guarded(100)
    connection.receive(start("a", 10))
    for part in range(5):
        connection.receive(FileTransferPart("button", "a", part, b"x" * 30))
        connection.receive(FileTransferPart("button", "b", part, b"x" * 10))
    assert set(states) == {"b"}
    client.add_notification.assert_called_once()


def test_many_files_at_once_are_not_more_than_one():
    _, connection, states = guarded(100)
    for part in range(3):
        connection.receive(FileTransferPart("button", "a", part, b"x" * 20))
        connection.receive(FileTransferPart("button", "b", part, b"x" * 20))
    assert set(states) == {"a"}
    states["c"] = {}
    connection.receive(FileTransferPart("button", "c", 0, b"x" * 40))
    assert set(states) == {"a", "c"}, "what was dropped counts no more"


def test_a_file_that_is_still_watched_is_not_written_over(tmp_path):
    first, second = (kept_upload(tmp_path, "a.mp4", content) for content in (b"one", b"two"))
    first.path.unlink()
    third = kept_upload(tmp_path, "a.mp4", b"three")
    assert (second.path.read_bytes(), third.path.read_bytes()) == (b"two", b"three")


def test_a_name_is_only_for_show(tmp_path):
    first, second = (kept_upload(tmp_path, "../../etc/passwd", content) for content in (b"one", b"two"))
    assert first.name == "../../etc/passwd"
    assert first.path.parent == second.path.parent == tmp_path
    assert (first.path.read_bytes(), second.path.read_bytes()) == (b"one", b"two")
