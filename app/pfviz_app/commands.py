"""What a visitor can ask for. Widgets and keys only put these on the session's queue."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
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
class Drag:
    """Take the toy's target to this pixel of the canvas; at the ``end`` of it, let go."""

    x: float
    y: float
    end: bool = False


@dataclass(frozen=True, slots=True)
class Keep:
    """Keep what is, to compare with what is changed from here on."""


@dataclass(frozen=True, slots=True)
class Select:
    """Follow what lies in this rectangle of the canvas, from the frame on screen on."""

    left: float
    top: float
    right: float
    bottom: float


@dataclass(frozen=True, slots=True)
class Outline:
    """Begin to click an outline of what is to be followed, or finish it."""


@dataclass(frozen=True, slots=True)
class Load:
    """Another video: ``path`` on the server, which is deleted after it is closed; ``name`` as the visitor knows it."""

    path: Path
    name: str


@dataclass(frozen=True, slots=True)
class Open:
    """Go to what a share code stands for."""

    code: str


@dataclass(frozen=True, slots=True)
class Arrange:
    """Show one of the situations of the gallery."""

    name: str


@dataclass(frozen=True, slots=True)
class Ask:
    """Answer something about the picture on screen, in the thread that alone may look at it."""

    answer: Callable[[Any], None]


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


Command = (
    Set
    | Play
    | Step
    | Walk
    | Seek
    | Click
    | Drag
    | Keep
    | Select
    | Outline
    | Load
    | Open
    | Arrange
    | Ask
    | Reset
    | Resize
    | Close
)


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
    if isinstance(later, Drag) and isinstance(earlier, Drag):
        return not earlier.end and not later.end
    return type(later) is type(earlier) and isinstance(later, Seek | Resize)
