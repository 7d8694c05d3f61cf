"""A visitor's own video, and what is followed in it."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import viser

from pfviz_app.commands import Command, Outline, Select
from pfviz_app.picture import Picture
from pfviz_app.uploads import UPLOAD_BYTES, guard_uploads, kept_upload

_SELECT, _CANCEL = "▭ Select in the picture", "▭ Now drag a rectangle …"
_OUTLINE, _DONE = "✎ Click an outline", "✎ Follow the outline"


class OwnVideo:
    """The folder in which a visitor brings a video and marks what is to be followed."""

    def __init__(self, client: viser.ClientHandle, post: Callable[[Command], None]) -> None:
        self._client, self._post = client, post
        self._folder = tempfile.TemporaryDirectory(prefix="pfviz-", ignore_cleanup_errors=True)
        gui = client.gui
        guard_uploads(client, UPLOAD_BYTES)
        with gui.add_folder("Your own video", expand_by_default=False):
            most = f"A video or an image of at most {UPLOAD_BYTES // 2**20} MB"
            self._upload = gui.add_upload_button("⤒ Upload a video", color="gray", hint=most)
            self._upload.on_upload(self._uploaded)
            self._select = gui.add_button(
                _SELECT, color="gray", hint="Follow what is in a rectangle. Or hold Shift and drag"
            )
            self._select.on_click(self._begin_selecting)
            self._outline = gui.add_button(
                _OUTLINE, color="gray", hint="Follow what is inside an outline, corner by corner"
            )
            self._outline.on_click(self._toggle_outline)
        self._selecting = False
        client.scene.on_rect_select(modifier="shift")(self._selected)

    def close(self) -> None:
        """The visitor has left."""
        self._folder.cleanup()

    def show(self, picture: Picture) -> None:
        label = _OUTLINE if picture.outline is None else _DONE
        if self._outline.label != label:
            self._outline.label = label

    def _uploaded(self, event: Any) -> None:
        """Not a coroutine: all visitors would wait until the file is written."""
        file = event.target.value
        try:
            self._post(kept_upload(Path(self._folder.name), file.name, file.content))
        except OSError as error:
            self._client.add_notification("The video cannot be kept", error.strerror or "", color="red")

    async def _begin_selecting(self, _: Any) -> None:
        """Until a rectangle is drawn or the button is pressed again, a drag on the picture draws one."""
        self._stop_selecting() if self._selecting else self._start_selecting()

    def _start_selecting(self) -> None:
        self._selecting = True
        self._select.label = _CANCEL
        self._client.scene.on_rect_select()(self._selected_once)

    def _stop_selecting(self) -> None:
        self._selecting = False
        self._select.label = _SELECT
        self._client.scene.remove_rect_select_callback(self._selected_once)

    def _selected_once(self, event: viser.SceneRectSelectEvent) -> None:
        self._stop_selecting()
        self._selected(event)

    def _selected(self, event: viser.SceneRectSelectEvent) -> None:
        width, height = self._client.camera.image_width, self._client.camera.image_height
        (left, top), (right, bottom) = event.screen_min, event.screen_max
        self._post(Select(left * width, top * height, right * width, bottom * height))

    async def _toggle_outline(self, _: Any) -> None:
        self._post(Outline())
