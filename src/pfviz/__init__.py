"""Particle filters you can see.

``pfviz.show(world, filter)`` opens the app on a world or a filter of your own. The library itself is in the modules:
``pfviz.filters``, ``pfviz.worlds``, ``pfviz.running``, ``pfviz.exact``, ``pfviz.vision``.
"""

from __future__ import annotations

from typing import Any


def __getattr__(name: str) -> Any:
    """``show`` comes from the app, which says so in its entry points; the library does not import it."""
    if name == "show":
        from importlib.metadata import entry_points

        for entry_point in entry_points(group="pfviz.apps", name="show"):
            return entry_point.load()
    raise AttributeError(f"module 'pfviz' has no attribute {name!r}")
