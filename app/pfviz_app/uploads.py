"""What a visitor sends: not more than is allowed, and kept in a file only as long as it is read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import viser
from viser._messages import FileTransferPart, FileTransferStartUpload

from pfviz_app.commands import Load

UPLOAD_BYTES = 200 * 2**20
"""The largest file that a visitor may send."""


def kept_upload(folder: Path, name: str, content: bytes) -> Load:
    """Write what was sent into a file of its own in ``folder``; the name it came with is only for show."""
    number = sum(1 for _ in folder.iterdir())
    path = folder / f"upload-{number}"
    path.write_bytes(content)
    return Load(path, name)


def guard_uploads(client: viser.ClientHandle, most: int) -> None:
    """Drop what a visitor sends beyond ``most`` bytes as it comes in: viser itself would keep it all in memory."""
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
        total = received.get(message.transfer_uuid, 0) + len(message.content)
        received[message.transfer_uuid] = total
        if total > most:
            drop(message.transfer_uuid)

    connection.register_handler(FileTransferStartUpload, started)
    connection.register_handler(FileTransferPart, part)
