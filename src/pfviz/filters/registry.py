"""The filters by name, with what there is to know of each at a glance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from pfviz.filters.basic_sir import BasicSir
from pfviz.filters.condensation import Condensation
from pfviz.filters.rb_hs_sir import RbHsSir
from pfviz.model import Model
from pfviz.names import find
from pfviz.particles import ParticleSet
from pfviz.record import StepRecord


class Filter(Protocol):
    """A filter: frozen hyper-parameters with ``initial`` and ``step``. Anything of this form can be shown."""

    def initial(self, rng: np.random.Generator, model: Model) -> ParticleSet:
        """The particle set at time 0, drawn from the model's prior."""
        ...

    def step(self, rng: np.random.Generator, model: Model, particles: ParticleSet, observation: Any) -> StepRecord:
        """One iteration, recorded stage by stage. ``rng`` is used for its seed: equal seeds, equal steps."""
        ...


@dataclass(frozen=True, slots=True)
class FilterInfo:
    """A filter's name, how to make it, and its place in the literature.

    Attributes:
        name: as on the command line.
        title: as on the screen.
        make: called with ``n_particles`` and the filter's other settings.
        summary: one line on what it does.
        source: where it is described.
        unbiased: whether its estimate of the evidence is unbiased.
        cost: evaluations a step.
    """

    name: str
    title: str
    make: Callable[..., Filter]
    summary: str
    source: str
    unbiased: bool
    cost: str


_ALL = (
    FilterInfo(
        "condensation",
        "CONDENSATION",
        Condensation,
        "the dynamics propose, the image only weighs (bootstrap filter)",
        "Isard & Blake 1998",
        True,
        "N likelihoods, N transitions",
    ),
    FilterInfo(
        "basic-sir",
        "Basic-SIR",
        BasicSir,
        "the detector proposes; innovation i is joined to history i, whatever they are",
        "Torma & Szepesvari, Table 1",
        True,
        "N likelihoods, N transitions",
    ),
    FilterInfo(
        "rb-hs-sir",
        "RB-HS-SIR",
        RbHsSir,
        "the detector proposes; every innovation samples a history that could have produced it",
        "Torma & Szepesvari, Table 3",
        True,
        "N likelihoods, N^2 transitions",
    ),
    FilterInfo(
        "rb-ss-hs-sir",
        "RB-SS-HS-SIR",
        RbHsSir,
        "the same where the detector proposes some components only; the dynamics complete the rest",
        "Torma & Szepesvari, Table 4",
        True,
        "N likelihoods, N^2 transitions",
    ),
)
FILTERS: dict[str, FilterInfo] = {info.name: info for info in _ALL}


def make_filter(name: str, n_particles: int = 400, **settings: Any) -> Filter:
    """The filter called ``name``.

    Raises:
        UnknownName: if there is no filter of that name; the message suggests the nearest.
        FilterError: if a setting is out of range.
    """
    return find(FILTERS, name, "filter").make(n_particles=n_particles, **settings)
