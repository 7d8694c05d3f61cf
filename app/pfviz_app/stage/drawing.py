"""A drawing that is done: it can be shown on many screens, and knows what its pixels stand for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from pfviz.particles import FloatArray, IntArray
from pfviz_app.films import Point
from pfviz_app.picture import Pick
from pfviz_app.stage.layout import RoomName

_REACH = 16.0
_OVERHEAD = 400
"""Roughly what a mark takes beside its data, in bytes."""


@dataclass(frozen=True, eq=False)
class Mark:
    """One thing on a drawing.

    Attributes:
        kind: of the scene's node.
        properties: of the node, as viser sends them.
        place: of the node, in the scene.
    """

    kind: Literal["lines", "points", "image"]
    properties: dict[str, Any]
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @cached_property
    def arrays(self) -> tuple[tuple[str, str, memoryview], ...]:
        """Those of the properties that are arrays: name, type and content."""
        found = [(key, value) for key, value in self.properties.items() if isinstance(value, np.ndarray)]
        return tuple((key, value.dtype.str, value.data) for key, value in found)

    @property
    def nbytes(self) -> int:
        """Roughly how much memory it takes."""
        return _OVERHEAD + sum(content.nbytes for _, _, content in self.arrays)


@dataclass(frozen=True, slots=True, eq=False)
class Target:
    """Places that can be clicked.

    Attributes:
        room: in which they are.
        points: ``(n, 2)``, in pixels.
        indices: ``(n,)``, the particles that they stand for.
        rival: whether these are of the filter that is compared with.
    """

    room: RoomName
    points: NDArray[np.float64]
    indices: IntArray
    rival: bool


class Toy(Protocol):
    """What knows where in the toy's world a pixel lies."""

    def place(self, x: float, y: float) -> FloatArray: ...


class Frame(Protocol):
    """What knows where in the video's frame a pixel lies."""

    def place(self, x: float, y: float) -> Point | None: ...


@dataclass(frozen=True, slots=True, eq=False)
class Drawing:
    """Named marks in pixels of the canvas.

    Attributes:
        marks: by name.
        targets: what can be clicked.
        grips: the names of the marks that can be taken hold of.
        toy: the toy room, where it is shown.
        frame: the video's room, where it is shown.
    """

    marks: Mapping[str, Mark]
    targets: tuple[Target, ...]
    grips: frozenset[str]
    toy: Toy | None
    frame: Frame | None

    @property
    def nbytes(self) -> int:
        """Roughly how much memory it takes."""
        return sum(mark.nbytes for mark in self.marks.values())

    def pick(self, x: float, y: float) -> Pick | None:
        """The particle nearest to a pixel, within reach of a finger."""
        best, found = _REACH, None
        for target in self.targets:
            if len(target.points):
                distances = np.hypot(target.points[:, 0] - x, target.points[:, 1] - y)
                nearest = int(np.argmin(distances))
                if distances[nearest] < best:
                    best = float(distances[nearest])
                    found = Pick(target.room, int(target.indices[nearest]), target.rival)
        return found
