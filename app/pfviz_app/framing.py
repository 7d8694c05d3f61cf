"""How a tab's HTML is set."""

from __future__ import annotations


def framed(content: str) -> str:
    """HTML in the lettering and with the margins that all tabs have."""
    return f'<div style="font-size:12.5px;line-height:1.4;padding:6px 12px 10px">{content}</div>'
