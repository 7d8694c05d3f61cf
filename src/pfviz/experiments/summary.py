"""What follows from the rows of an experiment, as data: tables, figures, sentences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pfviz.particles import FloatArray

Cell = str | int | float | None


@dataclass(frozen=True, slots=True)
class Table:
    """A table that is written as CSV and shown in the report.

    Attributes:
        name: of its file.
        title: over it in the report.
        columns: their names.
        rows: as many cells each as there are columns; None for what there is not.
        shown: whether it is in the report as well, and not only a file.
    """

    name: str
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    shown: bool = True

    def column(self, name: str) -> list[Cell]:
        """The cells of one column."""
        index = self.columns.index(name)
        return [row[index] for row in self.rows]


@dataclass(frozen=True, slots=True)
class Curve:
    """A line with an interval about it.

    Attributes:
        label: in the legend.
        x: ``(n,)``.
        y: ``(n,)``; NaN where there is nothing to draw.
        low: ``(n,)``, the lower end of the interval, or None.
        high: ``(n,)``, the upper end.
    """

    label: str
    x: FloatArray
    y: FloatArray
    low: FloatArray | None = None
    high: FloatArray | None = None


@dataclass(frozen=True, slots=True)
class CurvePanel:
    """Curves over one axis."""

    title: str
    curves: tuple[Curve, ...]


@dataclass(frozen=True, slots=True)
class HeatPanel:
    """Values over two settings.

    Attributes:
        title: over it.
        columns: the settings along x.
        rows: the settings along y.
        values: ``(len(rows), len(columns))``; NaN where there is none.
        marked: ``(len(rows), len(columns))`` of truth values: the cells to outline; None for none.
    """

    title: str
    columns: tuple[float, ...]
    rows: tuple[float, ...]
    values: FloatArray
    marked: FloatArray | None = None


@dataclass(frozen=True, slots=True)
class CurveFigure:
    """Panels of curves side by side; with ``shared_y``, on one scale."""

    name: str
    title: str
    x_label: str
    y_label: str
    panels: tuple[CurvePanel, ...]
    log_x: bool = False
    log_y: bool = False
    shared_y: bool = True


@dataclass(frozen=True, slots=True)
class HeatFigure:
    """Panels of heat maps in a grid, on one colour scale.

    Attributes:
        across: how many panels there are in a row.
    """

    name: str
    title: str
    x_label: str
    y_label: str
    value_label: str
    panels: tuple[HeatPanel, ...]
    across: int = 3
    log_values: bool = False


Figure = CurveFigure | HeatFigure


@dataclass(frozen=True, slots=True)
class Summary:
    """All that is reported.

    Attributes:
        tables: numbers.
        figures: drawings of them.
        sentences: what follows from them, put together by code.
    """

    tables: Sequence[Table] = ()
    figures: Sequence[Figure] = ()
    sentences: Sequence[str] = ()
