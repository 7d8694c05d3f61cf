"""``pfviz worlds`` and ``pfviz filters``: what there is."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import Any

from pfviz.filters import FILTERS
from pfviz.worlds import WORLDS


def list_worlds(as_json: bool) -> None:
    """Print the toy worlds, one a line."""
    rows = (
        {
            "world": world.name,
            "title": world.title,
            "look_for": world.look_for,
            "order": world.model.dynamics.order,
            "dimension": world.model.dynamics.dimension,
            "exact": world.model.exact,
            "particles": world.n_particles,
        }
        for world in WORLDS.values()
    )
    _print(rows, as_json, lambda row: f"{row['world']:<16} {row['look_for']}")


def list_filters(as_json: bool) -> None:
    """Print the filters, one a line."""
    rows = (
        {
            "filter": info.name,
            "title": info.title,
            "summary": info.summary,
            "source": info.source,
            "unbiased": info.unbiased,
            "cost": info.cost,
            "assumptions": info.assumptions,
        }
        for info in FILTERS.values()
    )
    _print(rows, as_json, _filter_line)


def _filter_line(row: Mapping[str, Any]) -> str:
    bias = "unbiased" if row["unbiased"] else "biased"
    cost = f"{row['cost']}; assumes {row['assumptions']}"
    return f"{row['filter']:<15} {bias:<9} {cost:<71} {row['summary']} ({row['source']})"


def _print(rows: Iterable[Mapping[str, Any]], as_json: bool, line: Any) -> None:
    for row in rows:
        print(json.dumps(row) if as_json else line(row))
