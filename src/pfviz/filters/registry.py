"""The filters by name, with what there is to know of each at a glance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from pfviz.filters.auxiliary import Auxiliary
from pfviz.filters.basic_sir import BasicSir
from pfviz.filters.condensation import Condensation
from pfviz.filters.hs_sir import HsSir
from pfviz.filters.icondensation import ICondensation
from pfviz.filters.innovation_sir import InnovationSir
from pfviz.filters.ls_hs_sir import LsHsSir
from pfviz.filters.ls_n_ips import LsNIps
from pfviz.filters.rb_hs_sir import RbHsSir
from pfviz.filters.unscented import Unscented
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
        likelihoods: how many likelihoods it evaluates a step, with N particles in k dimensions.
        transitions: how many densities or draws of the dynamics.
        assumptions: which of those of Torma & Szepesvari it makes: A, the state has a stochastic innovation and a
            shifted history; B and E, the proposal is a density of (some components of) the innovation that depends on
            the observation alone; D, the likelihood depends on the innovation alone. C, that likelihoods are dear, is
            why the cost counts them apart.
    """

    name: str
    title: str
    make: Callable[..., Filter]
    summary: str
    source: str
    unbiased: bool
    likelihoods: str
    transitions: str
    assumptions: str = ""

    @property
    def cost(self) -> str:
        """Evaluations a step, in words."""
        return f"{self.likelihoods} likelihoods, {self.transitions} transitions"


_ALL = (
    FilterInfo(
        "condensation",
        "CONDENSATION",
        Condensation,
        "the dynamics propose, the image only weighs (bootstrap filter)",
        "Isard & Blake 1998",
        True,
        "N",
        "N",
        "A, D",
    ),
    FilterInfo(
        "basic-sir",
        "Basic-SIR",
        BasicSir,
        "the detector proposes; innovation i is joined to history i, whatever they are",
        "Torma & Szepesvari, Table 1",
        True,
        "N",
        "N",
        "A, B, D, E",
    ),
    FilterInfo(
        "hs-sir",
        "HS-SIR",
        HsSir,
        "the detector proposes; innovations are drawn by their worth to all histories, then a history for each",
        "Torma & Szepesvari, Table 2",
        True,
        "N",
        "2 N^2",
        "A, B, D, E; Gaussian noise",
    ),
    FilterInfo(
        "rb-hs-sir",
        "RB-HS-SIR",
        RbHsSir,
        "the detector proposes; every innovation samples a history that could have produced it",
        "Torma & Szepesvari, Table 3",
        True,
        "N",
        "N^2",
        "A, B, D, E; Gaussian noise",
    ),
    FilterInfo(
        "rb-ss-hs-sir",
        "RB-SS-HS-SIR",
        RbHsSir,
        "the same where the detector proposes some components only; the dynamics complete the rest",
        "Torma & Szepesvari, Table 4",
        True,
        "N",
        "N^2",
        "A, B, D, E; Gaussian noise",
    ),
    FilterInfo(
        "innovation-sir",
        "Innovation-SIR",
        InnovationSir,
        "the detector proposes; every history samples an innovation that it could have produced",
        "Torma & Szepesvari, section 2, other variants",
        True,
        "N",
        "N^2",
        "A, B, D, E; Gaussian noise",
    ),
    FilterInfo(
        "icondensation",
        "ICondensation",
        ICondensation,
        "predicts, proposes or starts anew, particle by particle; arbitrary histories with the weight of sampled ones",
        "Isard & Blake 1998 (ECCV)",
        False,
        "N",
        "up to N^2",
        "A, B, D, E; Gaussian noise",
    ),
    FilterInfo(
        "auxiliary",
        "Auxiliary",
        Auxiliary,
        "looks at the likelihood ahead of each history before resampling",
        "Pitt & Shephard 1999",
        True,
        "2 N or more",
        "2 N",
        "A, D",
    ),
    FilterInfo(
        "unscented",
        "Unscented",
        Unscented,
        "every particle has an unscented Kalman filter of its own that proposes",
        "van der Merwe et al. 2000",
        True,
        "N (or 2 N + N k (k + 3) / 2)",
        "N",
        "A, D; Gaussian noise",
    ),
    FilterInfo(
        "ls-n-ips",
        "LS-N-IPS",
        LsNIps,
        "predicted particles climb the likelihood before they are weighed",
        "Torma & Szepesvari 2001 (NOLCOS)",
        False,
        "N (1 + 6 k)",
        "N",
        "A, D",
    ),
    FilterInfo(
        "ls-hs-sir",
        "LS-HS-SIR",
        LsHsSir,
        "scouts climb the likelihood, innovations are drawn where they end, histories are sampled",
        "Torma & Szepesvari, future work",
        True,
        "N + N (1 + 6 k) / 4",
        "9/4 N^2",
        "A, B, D, E; Gaussian noise",
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
