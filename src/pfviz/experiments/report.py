"""Tables as CSV, figures, and a report in Markdown whose sentences follow from the tables."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from math import isfinite
from pathlib import Path
from typing import Any

from pfviz.experiments.charts import write_figure
from pfviz.experiments.experiment import Experiment
from pfviz.experiments.results import write_atomically
from pfviz.experiments.summary import Cell, Summary, Table


def write_report(
    experiment: Experiment, seeds: int, summary: Summary, folder: Path, machine: Mapping[str, Any]
) -> Path:
    """Write everything that is reported into ``folder``; the path of the report."""
    for table in summary.tables:
        write_atomically(folder / f"{table.name}.csv", as_csv(table))
    for figure in summary.figures:
        write_figure(figure, folder)
    path = folder / f"{experiment.name}.md"
    write_atomically(path, as_markdown(experiment, seeds, summary, machine))
    return path


def as_csv(table: Table) -> str:
    """``table`` as comma-separated values, an empty cell for what there is not, and for the end of an open interval."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table.columns)
    writer.writerows([[_plain(cell) for cell in row] for row in table.rows])
    return text.getvalue()


def as_markdown(experiment: Experiment, seeds: int, summary: Summary, machine: Mapping[str, Any]) -> str:
    """The report."""
    parts = [f"# {experiment.title}", experiment.question]
    parts.append("\n".join(f"- {sentence}" for sentence in summary.sentences) or "Nothing can be said yet.")
    for figure in summary.figures:
        parts.append(f"![{figure.title}]({figure.name}.svg)")
    for table in (table for table in summary.tables if table.shown):
        parts.append(f"## {table.title}\n\n{table_in_markdown(table)}")
    described = ", ".join(f"{name} {value}" for name, value in machine.items())
    parts.append(
        f"Made by `pfviz experiment {experiment.name} --seeds {seeds}`. Intervals are of 95 % over the runs: Wilson's "
        f"for shares, Student's for means. Measured on: {described}."
    )
    return "\n\n".join(parts) + "\n"


def table_in_markdown(table: Table) -> str:
    """``table`` with its numbers rounded to three digits and aligned to the right."""
    numeric = [
        all(isinstance(row[i], (int, float)) or row[i] is None for row in table.rows) for i in range(len(table.columns))
    ]
    lines = [_line(table.columns), _line(["---:" if right else "---" for right in numeric])]
    lines += [_line([_rounded(cell) for cell in row]) for row in table.rows]
    return "\n".join(lines)


def _line(cells: Any) -> str:
    return f"| {' | '.join(cells)} |"


def _plain(cell: Cell) -> Cell:
    if _is_open(cell):
        return ""
    return f"{cell:.6g}" if isinstance(cell, float) else cell


def _is_open(cell: Cell) -> bool:
    """Whether there is no such number: it was not measured, or the interval has no end."""
    return cell is None or (isinstance(cell, float) and not isfinite(cell))


def _rounded(cell: Cell) -> str:
    if _is_open(cell):
        return "–"
    return f"{cell:.3g}" if isinstance(cell, float) else str(cell).replace("|", "\\|")
