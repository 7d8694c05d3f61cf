"""Particle filters you can see.

``pfviz.show(world, filter)`` opens the app on a world or a filter of your own. The names below are those that scripts
need; they are loaded when they are asked for, so that importing pfviz costs nothing. The rest is in the modules:
``pfviz.filters``, ``pfviz.worlds``, ``pfviz.exact``, ``pfviz.record``, ``pfviz.vision``.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pfviz.dynamics import Autoregression
    from pfviz.exact import Gaussian, kalman_filter, total_variation
    from pfviz.filters import FILTERS, Filter, make_filter
    from pfviz.model import Dynamics, Model, Proposal
    from pfviz.observations import GaussianObservation, LookAlikes, SquaredObservation
    from pfviz.particles import ParticleSet
    from pfviz.proposals import GaussianMixture
    from pfviz.record import StepRecord, Trace
    from pfviz.running import run
    from pfviz.worlds import WORLDS, Detector, Recording, ToyModel, World, get_world

    show: Any

_HOME = {
    "Autoregression": "dynamics",
    "Detector": "worlds",
    "Dynamics": "model",
    "FILTERS": "filters",
    "Filter": "filters",
    "Gaussian": "exact",
    "GaussianMixture": "proposals",
    "GaussianObservation": "observations",
    "LookAlikes": "observations",
    "Model": "model",
    "ParticleSet": "particles",
    "Proposal": "model",
    "Recording": "worlds",
    "SquaredObservation": "observations",
    "StepRecord": "record",
    "ToyModel": "worlds",
    "Trace": "record",
    "WORLDS": "worlds",
    "World": "worlds",
    "get_world": "worlds",
    "kalman_filter": "exact",
    "make_filter": "filters",
    "run": "running",
    "total_variation": "exact",
}

__all__ = [
    "FILTERS",
    "WORLDS",
    "Autoregression",
    "Detector",
    "Dynamics",
    "Filter",
    "Gaussian",
    "GaussianMixture",
    "GaussianObservation",
    "LookAlikes",
    "Model",
    "ParticleSet",
    "Proposal",
    "Recording",
    "SquaredObservation",
    "StepRecord",
    "ToyModel",
    "Trace",
    "World",
    "get_world",
    "kalman_filter",
    "make_filter",
    "run",
    "show",
    "total_variation",
]


def __getattr__(name: str) -> Any:
    """Load a public name. ``show`` comes from the app, by its entry point; the library does not import the app."""
    if name in _HOME:
        return getattr(import_module(f"pfviz.{_HOME[name]}"), name)
    if name == "show":
        from importlib.metadata import entry_points

        for entry_point in entry_points(group="pfviz.apps", name="show"):
            return entry_point.load()
    raise AttributeError(f"module 'pfviz' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
