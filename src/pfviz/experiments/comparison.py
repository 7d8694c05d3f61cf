"""Filters side by side at one place, or over the values of one knob: the small experiment that an app can run."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from pfviz.experiments.cells import Arm, difference, grouped, is_film, mean, plain_mean, run_cells, time_table
from pfviz.experiments.experiment import Experiment, ExperimentError, Job, Row, Settings, blocks
from pfviz.experiments.statistics import sign_of, wilson
from pfviz.experiments.summary import Cell, Curve, CurveFigure, CurvePanel, Summary, Table

KNOBS = {
    "particles": "particles",
    "system": "system noise, as a factor",
    "observation": "observation noise, as a factor",
    "proposal": "width of the proposal, as a factor",
}
"""What can be varied."""


def comparison(
    place: str,
    arms: Sequence[Arm],
    knob: str | None = None,
    values: Sequence[float] = (),
    seeds: int = 10,
    **settings: Any,
) -> Experiment:
    """An experiment on ``arms`` at one ``place``.

    Args:
        place: a toy world, ``scene:NAME``, ``scene:NAME:SEED`` or ``clip:NAME``.
        arms: the contestants; the first is what the others are held against.
        knob: a key of ``KNOBS`` to vary, if any.
        values: that it takes.
        seeds: at full size.
        **settings: the same for all, as ``toy_run`` or ``tracker_run`` take them: ``system``, ``observation``,
            ``proposal``, for a toy world ``steps``.

    Raises:
        ExperimentError: if the knob is none, or there are no arms.
    """
    if knob is not None and knob not in KNOBS:
        raise ExperimentError(f"knob: expected one of {', '.join(KNOBS)}, got {knob!r}")
    if not arms:
        raise ExperimentError("arms: expected at least one filter")
    cells = [arm.at(place, **settings, **({knob: value} if knob else {})) for value in values or [0] for arm in arms]
    return Experiment(
        name="comparison",
        title=f"Filters at {place}",
        question="Which filter follows better, with these settings?",
        seeds=seeds,
        jobs=partial(_jobs, cells),
        run=run_cells,
        summarise=partial(summarise, knob=knob),
    )


def _jobs(cells: Sequence[Settings], seeds: int) -> list[Job]:
    return blocks(cells, seeds, 1 if is_film(cells[0]["place"]) else 5)


def summarise(rows: Sequence[Row], knob: str | None = None) -> Summary:
    """A row for every filter and value of the knob; curves over the knob; who is better, where intervals tell."""
    names = ("label", knob) if knob else ("label",)
    columns = ("runs", "error", "error low", "error high", "followed", "followed low", "followed high")
    table = Table(
        "comparison",
        "Filters side by side",
        ("filter", *([knob] if knob else []), *columns, "ESS share"),
        tuple(_line(key, members) for key, members in grouped(rows, *names).items()),
    )
    return Summary(
        (table, time_table(rows, *names)), (_figure(rows, knob),) if knob and rows else (), _sentences(rows, knob)
    )


def _line(key: tuple[Any, ...], members: Sequence[Row]) -> tuple[Cell, ...]:
    error = mean(members, "error")
    followed = wilson(sum(map(followed_to_the_end, members)), len(members))
    numbers = (error.value, error.low, error.high, followed.value, followed.low, followed.high)
    return (*key, len(members), *numbers, plain_mean(members, "ess_share"))


def followed_to_the_end(row: Row) -> bool:
    """Whether the filter was still, or again, at the object when a run ended."""
    return bool(row["tracked"]) if "tracked" in row else not row["lost_at_end"]


def _figure(rows: Sequence[Row], knob: str) -> CurveFigure:
    curves = []
    for (label,), members in grouped(rows, "label").items():
        points = sorted((value, mean(same, "error")) for (value,), same in grouped(members, knob).items())
        x, y = np.array([value for value, _ in points], dtype=float), [e.value for _, e in points]
        low, high = np.array([e.low for _, e in points]), np.array([e.high for _, e in points])
        bounded = np.isfinite(low) & np.isfinite(high)
        curves.append(Curve(label, x, np.array(y), np.where(bounded, low, np.nan), np.where(bounded, high, np.nan)))
    panel = CurvePanel(rows[0]["place"], tuple(curves))
    return CurveFigure("comparison", f"Error against {knob}", KNOBS[knob], "error", (panel,), log_x=True)


def _sentences(rows: Sequence[Row], knob: str | None) -> list[str]:
    sentences = []
    for (value,), members in grouped(rows, knob or "place").items():
        where = f"With {knob} {value:g}: " if knob else ""
        arms = list(grouped(members, "label").items())
        for (label,), of_arm in arms[1:]:
            (first,), of_first = arms[0]
            gap = difference(of_arm, of_first, "error")
            order = {"less": "a smaller error than", "greater": "a greater error than"}.get(sign_of(gap))
            if order:
                sentences.append(f"{where}{label} has {order} {first} (difference {gap}, {gap.count} runs each).")
            else:
                sentences.append(f"{where}{gap.count} runs cannot tell the errors of {label} and {first} apart.")
    return sentences
