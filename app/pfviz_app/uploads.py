"""What a visitor sends: not more than is allowed, and kept in a file only as long as it is read."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import viser
from viser._messages import FileTransferPart, FileTransferStartUpload

from pfviz_app.commands import Load

UPLOAD_BYTES = 200 * 2**20
"""The largest file that a visitor may send."""


def kept_upload(folder: Path, name: str, content: bytes) -> Load:
    """Write what was sent into a file of its own in ``folder``; the name it came with is only for show."""
    number, path = tempfile.mkstemp(prefix="upload-", dir=folder)
    with open(number, "wb") as file:
        file.write(content)
    return Load(Path(path), name)


def guard_uploads(client: viser.ClientHandle, most: int) -> None:
    """Drop what a visitor sends beyond ``most`` bytes as it comes in: viser itself would keep it all in memory.

    Files that are sent at the same time count together.
    """
    connection: Any = client._websock_connection
    received: dict[str, int] = {}

    def drop(uuid: str) -> None:
        gui: Any = client.gui
        if gui._current_file_upload_states.pop(uuid, None) is not None:
            client.add_notification("Too large", f"A file may have {most // 2**20} MB at the most.", color="red")

    def started(_: int, message: FileTransferStartUpload) -> None:
        if message.size_bytes > most:
            drop(message.transfer_uuid)

    def part(_: int, message: FileTransferPart) -> None:
        gui: Any = client.gui
        for ended in received.keys() - gui._current_file_upload_states.keys():
            del received[ended]
        if message.transfer_uuid in gui._current_file_upload_states:
            received[message.transfer_uuid] = received.get(message.transfer_uuid, 0) + len(message.content)
        if sum(received.values()) > most:
            drop(message.transfer_uuid)

    connection.register_handler(FileTransferStartUpload, started)
    connection.register_handler(FileTransferPart, part)
