"""Keep and share: codes and links that bring everything back, and files to take along."""

from __future__ import annotations

import html
import json
import secrets
import threading
import time
from collections.abc import Callable
from dataclasses import asdict

import viser

from pfviz_app.background import Background, Tell
from pfviz_app.command_lines import commands_of
from pfviz_app.commands import Ask, Command, Open
from pfviz_app.exports import toy_script
from pfviz_app.picture import Picture
from pfviz_app.settings import SettingError
from pfviz_app.share import Shared, encode
from pfviz_app.takeaways import SLOW_TAKEAWAYS, TAKEAWAYS

_KEPT = "pfviz-link-"
_WAITS = (0.2, 0.5, 1.0, 2.0, 4.0)

_READ_LINK = """<img src="data:," alt="" hidden onerror="
  const code = new URLSearchParams(location.search).get('code') ?? '';
  localStorage.setItem('viser-user:{key}', code);
">"""
"""viser does not pass the page's address on, but lets the server read what the page has stored under its prefix."""

_COPY = """<button type="button" data-text="{text}" data-link="{link}" style="{style}" onclick="
  const link = location.origin + location.pathname + '?code=' + this.dataset.text;
  const text = this.dataset.link ? link : this.dataset.text;
  const area = document.createElement('textarea');
  area.value = text; document.body.append(area); area.select(); document.execCommand('copy'); area.remove();
  const label = this.textContent; this.textContent = 'copied'; setTimeout(() => this.textContent = label, 900);
">{label}</button>"""
_BUTTON = (
    "font:inherit;font-size:12px;padding:2px 7px;margin:0 3px 5px 0;border-radius:5px;cursor:pointer;"
    "border:1px solid #8886;background:transparent;color:inherit"
)


class Sharing:
    """The folder with which a visitor keeps what is on screen, or passes it on."""

    def __init__(self, client: viser.ClientHandle, post: Callable[[Command], None]) -> None:
        self._client = client
        self._shared: Shared | None = None
        gui = client.gui
        with gui.add_folder("Keep and share", expand_by_default=False):
            self._code = gui.add_text("Code", "", hint="Brings back exactly this")
            opening = gui.add_button("Open this code", color="gray")
            self._copies = gui.add_html("")
            self._what = gui.add_dropdown("Take away", (*TAKEAWAYS, *SLOW_TAKEAWAYS))
            taking = gui.add_button("⤓ Download", color="gray")
            cancelling = gui.add_button("■ Cancel what is being made", color="gray", visible=False)
        self._background = Background(client, lambda busy: setattr(cancelling, "visible", busy))

        @opening.on_click
        async def _(_: object) -> None:
            post(Open(self._code.value))

        @taking.on_click
        async def _(_: object) -> None:
            post(Ask(self._take))

        @cancelling.on_click
        async def _(_: object) -> None:
            self._background.cancel()

        threading.Thread(target=_follow_link, args=(client, post), name="pfviz-link", daemon=True).start()

    def close(self) -> None:
        """The visitor has left."""
        self._background.cancel()

    def show(self, picture: Picture) -> None:
        """The share code of what is on screen, unless the film runs."""
        if picture.playing or (shared := picture.shared) == self._shared:
            return
        self._shared, code = shared, encode(shared)
        self._code.value = code
        log = picture.lane.log[: picture.t] or (picture.settings,)
        script = toy_script(log, picture.toy.film.held, picture.lane.plain)
        values = json.dumps(asdict(picture.settings) | {"t": picture.t}, indent=1)
        texts = {"code": code, "command": commands_of(picture), "script": script, "JSON": values}
        copies = (("link", code, True), *((label, text, False) for label, text in texts.items()))
        buttons = "".join(_copy_button(label, text, link) for label, text, link in copies)
        self._copies.content = f'<div style="padding:2px 12px 4px;font-size:12px">Copy {buttons}</div>'

    def _take(self, picture: Picture) -> None:
        """Send the file that is chosen, or begin to make it; runs where the picture may be looked at."""
        if self._what.value in SLOW_TAKEAWAYS:
            self._take_slowly(*SLOW_TAKEAWAYS[self._what.value], picture)
            return
        name, make = TAKEAWAYS[self._what.value]
        waiting = self._client.add_notification("Making it …", name, loading=True, with_close_button=False)
        try:
            self._client.send_file_download(name, make(picture), save_immediately=True)
        except ValueError as error:
            raise SettingError(str(error)) from None
        finally:
            waiting.remove()

    def _take_slowly(self, name: str, maker: Callable[[Picture], Callable[[Tell], bytes]], picture: Picture) -> None:
        try:
            self._background.begin(name, maker(picture))
        except ValueError as error:
            raise SettingError(str(error)) from None


def _copy_button(label: str, text: str, link: bool = False) -> str:
    return _COPY.format(text=html.escape(text), link="1" if link else "", style=_BUTTON, label=label)


def _follow_link(client: viser.ClientHandle, post: Callable[[Command], None]) -> None:
    """Open the code that the page's address holds, if it holds one."""
    key = _KEPT + secrets.token_hex(4)
    client.gui.add_html(_READ_LINK.format(key=key))
    for wait in _WAITS:
        time.sleep(wait)
        try:
            code = client.local_storage.get_item(key, timeout=5.0)
        except (RuntimeError, TimeoutError):
            return
        if code is not None:
            client.local_storage.remove_item(key)
            if code:
                post(Open(code))
            return
