"""Looking things up by name, with a helpful answer when there is no such name."""

from __future__ import annotations

from collections.abc import Mapping
from difflib import get_close_matches
from typing import TypeVar

T = TypeVar("T")


class UnknownName(ValueError):
    """A name that is not in the list."""


def find(table: Mapping[str, T], name: str, kind: str) -> T:
    """``table[name]``.

    Raises:
        UnknownName: naming what there is, the nearest name first.
    """
    if name in table:
        return table[name]
    near = get_close_matches(name, table, n=1, cutoff=0.4)
    hint = f"did you mean '{near[0]}'? " if near else ""
    raise UnknownName(f"unknown {kind} '{name}': {hint}there are {', '.join(table)}")
