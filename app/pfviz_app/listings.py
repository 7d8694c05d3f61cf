"""``pfviz worlds``, ``pfviz filters`` and ``pfviz models``: what there is."""

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


def list_models(as_json: bool) -> None:
    """Print what the tracker can assume of an object, one a line: measurements, shape spaces, dynamics."""
    from pfviz.vision.motion import DEFAULT_DYNAMICS, DYNAMICS
    from pfviz.vision.shapes import DEFAULT_SHAPE, SHAPES, STATE_NAMES
    from pfviz.vision.tracker import DEFAULT_MODEL, MODELS

    shapes = {name: f"{', '.join(STATE_NAMES[:count])} of the outline change" for name, count in SHAPES.items()}
    tables = (("--model", MODELS, DEFAULT_MODEL), ("--shape", shapes, DEFAULT_SHAPE))
    rows = (
        {"option": option, "name": name, "summary": summary, "default": name == default}
        for option, table, default in (*tables, ("--dynamics", DYNAMICS, DEFAULT_DYNAMICS))
        for name, summary in table.items()
    )
    _print(rows, as_json, _model_line)


def _model_line(row: Mapping[str, Any]) -> str:
    return f"{row['option']:<11} {row['name']:<21} {row['summary']}{' (default)' if row['default'] else ''}"


def _print(rows: Iterable[Mapping[str, Any]], as_json: bool, line: Any) -> None:
    for row in rows:
        print(json.dumps(row) if as_json else line(row))
