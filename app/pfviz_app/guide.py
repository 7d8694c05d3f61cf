"""The help sheet: what can be done here, and with which keys."""

from __future__ import annotations

import viser

_KEYS = (
    ("Space", "play or pause"),
    ("→  ←", "one step forward, one back"),
    ("↓  ↑", "one stage of the iteration forward, one back"),
    ("R", "reset"),
    ("B", "branch: keep this run and compare it with what you change from here on"),
    ("F", "look squarely at the picture again"),
    ("H", "this sheet"),
)
_DEEDS = (
    ("Click a particle", "its receipt: how its weight came about, and whom it descends from"),
    ("Drag the ✥", "take the toy's target somewhere else and watch the filters chase it; while it plays, hold it"),
    ("Shift + drag a rectangle", "on the video: follow what is in it, from this frame on"),
    ("Drag beside the marks", "turn the picture: the floors of the 2-D toy are real"),
    ("Compare with", "a second filter on the same data and the same random numbers"),
    ("Situation", "prepared examples, each with what to look for"),
)


def guide_html() -> str:
    """The sheet."""
    return f"{_table(_KEYS)}{_table(_DEEDS)}"


def _table(rows: tuple[tuple[str, str], ...]) -> str:
    cell = "padding:3px 14px 3px 0;white-space:nowrap;font-weight:600;vertical-align:top"
    body = "".join(f'<tr><td style="{cell}">{key}</td><td>{what}</td></tr>' for key, what in rows)
    return f'<table style="font-size:13.5px;line-height:1.4;margin-bottom:14px">{body}</table>'


def show_guide(client: viser.ClientHandle) -> None:
    """Lay the sheet over the page."""
    modal = client.gui.add_modal("Help and keys")
    with modal:
        client.gui.add_html(guide_html())
        close = client.gui.add_button("Close")

    @close.on_click
    async def _(_: object) -> None:
        modal.close()
