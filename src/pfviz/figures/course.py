"""A run over time: effective sample size, error, evidence, weights and ancestors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pfviz.figures import style
from pfviz.genealogy import ancestor_counts
from pfviz.particles import FloatArray, IntArray
from pfviz.record import StepRecord, Trace

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLOURS = (style.POSTERIOR, style.RIVAL, style.HISTORY, style.PROPOSAL)
_LINES: Any = ("-", (0, (5, 1.5)), (0, (1.5, 1.2)), (0, (5, 1.5, 1, 1.5)))
_DEPTH = 60


@dataclass(frozen=True, slots=True)
class Course:
    """What is drawn of one run.

    Attributes:
        label: its name in the legend.
        times: ``(T,)``.
        effective_sample_shares: ``(T,)``, ESS divided by the number of particles.
        log_evidence: ``(T,)``, the sum of the increments so far; NaN from where one is not defined.
        weights: ``(N,)``, at the last time, as weighed.
        ancestors: ``(d + 1,)``, how many different ancestors the last particles have 0, 1, ..., d steps earlier.
        errors: ``(T,)``, distances from the truth, where it is known.
        exact_log_evidence: ``(T,)``, where it is known.
    """

    label: str
    times: IntArray
    effective_sample_shares: FloatArray
    log_evidence: FloatArray
    weights: FloatArray
    ancestors: IntArray
    errors: FloatArray | None = None
    exact_log_evidence: FloatArray | None = None


def course_of(
    trace: Trace,
    label: str,
    errors: Sequence[float] | FloatArray | None = None,
    exact_increments: Sequence[float] | FloatArray | None = None,
    last: int | None = None,
) -> Course:
    """What is drawn of a run, read from its records.

    Args:
        trace: the records; time runs from ``trace.first``.
        label: the run's name in the legend.
        errors: a number for each record, where the truth is known.
        exact_increments: of log p(y_1:t), one for each record, where they are known.
        last: the last time to draw; the last recorded by default.

    Raises:
        ValueError: if nothing is recorded up to ``last``, or a sequence has another length than the records.
    """
    last = trace.last if last is None else last
    records = [trace[t] for t in range(trace.first, last + 1)]
    if not records:
        raise ValueError(f"nothing is recorded up to time {last}")
    for name, values in (("errors", errors), ("exact_increments", exact_increments)):
        if values is not None and len(values) != len(records):
            raise ValueError(f"{name} must be one for each of {len(records)} records, got {len(values)}")
    increments = [np.nan if record.log_evidence is None else record.log_evidence for record in records]
    weighed = records[-1].stage("weight")
    weights = (weighed.particles if weighed else records[-1].posterior).weights
    return Course(
        label,
        np.arange(trace.first, last + 1),
        np.array([record.effective_sample_size / _weighed_count(record) for record in records]),
        np.cumsum(increments),
        weights,
        ancestor_counts(trace, last, _DEPTH),
        None if errors is None else np.asarray(errors, dtype=float),
        None if exact_increments is None else np.cumsum(exact_increments),
    )


def _weighed_count(record: StepRecord) -> int:
    weighed = record.stage("weight")
    return len(weighed.particles if weighed else record.posterior)


def plot_courses(courses: Sequence[Course], panels: Sequence[str] | None = None, title: str = "") -> Figure:
    """Runs over time, a panel a quantity, a line a run.

    Args:
        courses: one to four runs, such as a filter and its rival on the same data.
        panels: names of ``PANELS``, in the order they are drawn; by default all for which there is something to draw.
        title: above everything.

    Raises:
        ValueError: if there are no courses or too many, or there is no such panel.
    """
    if not 1 <= len(courses) <= len(_COLOURS):
        raise ValueError(f"courses must be 1 to {len(_COLOURS)} runs, got {len(courses)}")
    names = [name for name in PANELS if _has(courses, name)] if panels is None else list(panels)
    for name in names:
        if name not in PANELS:
            raise ValueError(f"panels must be among {', '.join(PANELS)}, got {name!r}")
    columns = min(len(names), 3)
    rows = -(-len(names) // max(columns, 1))
    top = 0.62 if title else 0.36
    width, height = 2.75 * columns + 0.3, 2.25 * rows + top
    figure = style.new_figure(width, height)
    for number, name in enumerate(names):
        row, column = divmod(number, columns)
        left, bottom = 2.75 * column + 0.62, 2.25 * (rows - 1 - row) + 0.5
        axes = figure.add_axes((left / width, bottom / height, 2.15 / width, 1.45 / height))
        style.quiet(axes)
        PANELS[name](axes, courses)
    _legend(figure, courses, title, height)
    return figure


def _has(courses: Sequence[Course], name: str) -> bool:
    return name != "error" or any(course.errors is not None for course in courses)


def _legend(figure: Figure, courses: Sequence[Course], title: str, height: float) -> None:
    from matplotlib.lines import Line2D

    if title:
        figure.text(0.5, 1.0 - 0.08 / height, title, ha="center", va="top", fontsize=12, color=style.INK)
    if len(courses) == 1 and title:
        return
    handles = [
        Line2D([], [], color=colour, linestyle=line, linewidth=1.8, label=course.label)
        for course, colour, line in zip(courses, _COLOURS, _LINES, strict=False)
    ]
    figure.legend(
        handles=handles,
        loc="upper center",
        bbox_to_anchor=(0.5, 1.0 - (0.3 if title else 0.02) / height),
        ncols=len(courses),
        frameon=False,
        fontsize=9,
        labelcolor=style.INK,
        borderaxespad=0.0,
    )


def _label(axes: Axes, title: str, across: str = "time t") -> None:
    axes.set_title(title, fontsize=9.5, color=style.INK, loc="left", pad=5)
    axes.set_xlabel(across, fontsize=8.5, color=style.INK, labelpad=2)


def _line(axes: Axes, number: int, x: FloatArray | IntArray, y: FloatArray | IntArray) -> None:
    axes.plot(x, y, color=_COLOURS[number], linestyle=_LINES[number], linewidth=1.4, zorder=3 + number)


def _ess(axes: Axes, courses: Sequence[Course]) -> None:
    for number, course in enumerate(courses):
        _line(axes, number, course.times, 100.0 * course.effective_sample_shares)
    axes.set_ylim(0.0, 103.0)
    _label(axes, "effective sample size, % of N")


def _error(axes: Axes, courses: Sequence[Course]) -> None:
    for number, course in enumerate(courses):
        if course.errors is not None:
            _line(axes, number, course.times, course.errors)
    axes.set_ylim(bottom=0.0)
    _label(axes, "error: distance from the truth")


def _evidence(axes: Axes, courses: Sequence[Course]) -> None:
    """Against the exact evidence where it is known for all: then differences can be seen."""
    known = all(course.exact_log_evidence is not None for course in courses)
    for number, course in enumerate(courses):
        exact = course.exact_log_evidence if known else None
        _line(axes, number, course.times, course.log_evidence if exact is None else course.log_evidence - exact)
    if known:
        axes.axhline(0.0, color=style.EXACT, linewidth=1.2, linestyle=(0, (4, 2)), zorder=2)
    _label(axes, "log-evidence, minus the exact" if known else "log-evidence so far")


def _weights(axes: Axes, courses: Sequence[Course]) -> None:
    for number, course in enumerate(courses):
        weights = np.sort(course.weights)[::-1] * len(course.weights)
        shown = weights > 0.0
        ranks = (np.arange(len(weights)) + 0.5) / len(weights)
        _line(axes, number, 100.0 * ranks[shown], weights[shown])
    axes.axhline(1.0, color=style.EXACT, linewidth=0.9, linestyle=(0, (4, 2)), zorder=2)
    axes.set_yscale("log")
    axes.set_ylim(bottom=1e-4)
    axes.set_xlim(0.0, 100.0)
    _label(axes, "weights, times N, heaviest first", "particles, %")


def _lorenz(axes: Axes, courses: Sequence[Course]) -> None:
    for number, course in enumerate(courses):
        held = np.concatenate([[0.0], np.cumsum(np.sort(course.weights))])
        _line(axes, number, np.linspace(0.0, 100.0, len(held)), 100.0 * held)
    axes.plot([0, 100], [0, 100], color=style.EXACT, linewidth=0.9, linestyle=(0, (4, 2)), zorder=2)
    axes.set_xlim(0.0, 100.0)
    axes.set_ylim(0.0, 103.0)
    _label(axes, "weight held by the lightest, %", "particles, %")


def _ancestors(axes: Axes, courses: Sequence[Course]) -> None:
    for number, course in enumerate(courses):
        _line(axes, number, np.arange(len(course.ancestors)), course.ancestors)
    axes.set_yscale("log")
    axes.set_ylim(bottom=0.8)
    _label(axes, "different ancestors", "steps back from the last")


PANELS: dict[str, Callable[..., None]] = {
    "ess": _ess,
    "error": _error,
    "evidence": _evidence,
    "weights": _weights,
    "lorenz": _lorenz,
    "ancestors": _ancestors,
}
"""The panels of ``plot_courses`` by name."""
