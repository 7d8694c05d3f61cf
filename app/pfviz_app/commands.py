"""What a visitor can ask for. Widgets and keys only put these on the session's queue."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Set:
    """Change one setting."""

    field: str
    value: Any


@dataclass(frozen=True, slots=True)
class Play:
    """Run on, or stop; ``on=None`` toggles."""

    on: bool | None = None


@dataclass(frozen=True, slots=True)
class Step:
    """Go ``count`` steps forward, or back where it is negative."""

    count: int = 1


@dataclass(frozen=True, slots=True)
class Walk:
    """Go ``count`` stages forward within the iteration and on into the next, or back where it is negative."""

    count: int = 1


@dataclass(frozen=True, slots=True)
class Seek:
    """Show time ``t`` of what is recorded."""

    t: int


@dataclass(frozen=True, slots=True)
class Click:
    """Choose what lies at this pixel of the canvas; nothing there, nothing chosen."""

    x: float
    y: float


@dataclass(frozen=True, slots=True)
class Open:
    """Go to what a share code stands for."""

    code: str


@dataclass(frozen=True, slots=True)
class Reset:
    """Begin again at time 0."""


@dataclass(frozen=True, slots=True)
class Resize:
    """The canvas has another size, in pixels."""

    width: int
    height: int


@dataclass(frozen=True, slots=True)
class Close:
    """The visitor has left."""


Command = Set | Play | Step | Walk | Seek | Click | Open | Reset | Resize | Close


def merged(commands: Iterable[Command]) -> list[Command]:
    """The commands without those that a later one of the same kind overrides before anything else happens.

    A slider that is dragged sends dozens of values; of a run of them only the last one matters.
    """
    result: list[Command] = []
    for command in commands:
        if result and _overrides(command, result[-1]):
            result[-1] = command
        else:
            result.append(command)
    return result


def _overrides(later: Command, earlier: Command) -> bool:
    if isinstance(later, Set) and isinstance(earlier, Set):
        return later.field == earlier.field
    return type(later) is type(earlier) and isinstance(later, Seek | Resize)
