"""Where particles come from: the lines of their ancestors, back through time, as they are drawn."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from pfviz.genealogy import ancestry, lineages, particles_at
from pfviz.particles import FloatArray
from pfviz_app.picture import Pick, Picture
from pfviz_app.room import Room
from pfviz_app.stage.seen import Seen

DEPTH = 14
"""How many generations are drawn."""


@dataclass(frozen=True, slots=True)
class Generation:
    """The ancestors of all particles at one time, and what became of them.

    Attributes:
        parents: ``(n, k)``, innovations at the earlier time.
        children: ``(n, k)``, innovations one step later, of those that have descendants among the particles.
        strengths: ``(n,)``, the part of all particles that descends through this join, as a strength from 0 to 1.
    """

    parents: FloatArray
    children: FloatArray
    strengths: FloatArray


def generations(room: Room[Any], t: int, depth: int = DEPTH) -> list[Generation]:
    """The last generations before the particles of time ``t``, the latest first."""
    rows, found = lineages(room.trace, t, depth), []
    for k, (below, above) in enumerate(pairwise(rows)):
        pairs, counts = np.unique(np.stack([below, above])[:, above >= 0], axis=1, return_counts=True)
        children, parents = particles_at(room.trace, t - k), particles_at(room.trace, t - k - 1)
        shares = np.sqrt(counts / len(rows[0]))
        found.append(Generation(parents.innovation[pairs[1]], children.innovation[pairs[0]], shares))
    return found


def line_of(picture: Picture, chosen: Pick, depth: int = DEPTH) -> FloatArray:
    """``(m, k)``: the particle that was clicked and its ancestors, the latest first."""
    room: Room[Any] = picture.toy if chosen.room == "toy" else picture.tracker
    trace, t = room.trace, picture.t
    seen = Seen(trace[t])
    joins, after = seen.joins(), seen.after()
    joined = np.flatnonzero(joins[2] == chosen.index)[:1] if joins else np.empty(0, np.int64)
    if joins is None or after is None or not len(joined):
        return np.empty((0, room.trace[t].previous.dimension))
    line = [after.particles.innovation[joined[0]]]
    history = int(joins[0][joined[0]])
    if history >= 0 and trace[t].previous is particles_at(trace, t - 1):
        ancestors = ancestry(trace, t - 1, history)[:depth]
        line += [particles_at(trace, time).innovation[index] for time, index in ancestors]
    return np.array(line)
