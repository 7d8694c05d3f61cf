"""What is written: numbers that can be read back, figures that open, the same bytes every time."""

from __future__ import annotations

import csv
import io
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import cv2
import numpy as np
import pytest
from small_experiments import run_here, toy_comparison

from pfviz.experiments.charts import pixels_of, write_figure
from pfviz.experiments.report import as_csv, as_markdown, table_in_markdown, write_report
from pfviz.experiments.summary import Curve, CurveFigure, CurvePanel, Figure, HeatFigure, HeatPanel, Table

TABLE = Table("t", "A table", ("filter", "N", "error"), (("a|b", 20, 1.23456789), ('say "x, y"', 400, None)))
NAN = float("nan")


def test_a_table_is_read_back_from_its_csv():
    header, first, second = list(csv.reader(io.StringIO(as_csv(TABLE))))
    assert header == ["filter", "N", "error"]
    assert first == ["a|b", "20", "1.23457"]
    assert second == ['say "x, y"', "400", ""]


def test_what_was_not_measured_and_ends_of_open_intervals_are_empty():
    table = Table("t", "", ("a", "b", "c"), ((NAN, float("inf"), -float("inf")),))
    assert as_csv(table).splitlines()[1] == ",,"
    assert table_in_markdown(table).splitlines()[2] == "| – | – | – |"


def test_a_table_in_markdown_has_as_many_cells_in_every_line():
    lines = table_in_markdown(TABLE).splitlines()
    assert lines[1] == "| --- | ---: | ---: |"
    assert lines[2] == "| a\\|b | 20 | 1.23 |"
    assert lines[3].endswith("| – |")


def figures() -> list[Figure]:
    x = np.array([1.0, 10.0, 100.0])
    curve = Curve("A", x, np.array([1.0, NAN, 3.0]), np.array([0.5, NAN, -900.0]), np.array([1.5, NAN, 900.0]))
    panels = tuple(CurvePanel(f"panel {i}", (curve, Curve(f"B{i}", x, x))) for i in range(4))
    heat = HeatPanel("N = 20", (0.1, 1.0), (1.0, 2.0), np.array([[1.0, NAN], [0.0, 3.0]]), np.eye(2))
    return [
        CurveFigure("curves", "Curves", "x", "y", panels, log_x=True),
        CurveFigure("none", "Nothing", "x", "y", (CurvePanel("", ()),)),
        HeatFigure("heat", "Heat", "x", "y", "value", (heat, heat), log_values=True),
        HeatFigure("cold", "All alike", "x", "y", "value", (HeatPanel("", (1.0,), (1.0,), np.full((1, 1), NAN)),)),
    ]


@pytest.mark.parametrize("figure", figures(), ids=lambda figure: figure.name)
def test_a_figure_is_a_picture_and_a_drawing_of_the_same_bytes_every_time(figure, tmp_path):
    written = [write_figure(figure, folder) for folder in (_made(tmp_path / "1"), _made(tmp_path / "2"))]
    (png, svg), (again_png, again_svg) = written
    image = cv2.imread(str(png))
    assert image.shape[0] > 300 and image.shape[1] > 500
    assert image.std() > 1.0
    text = " ".join(ElementTree.parse(svg).getroot().itertext())
    assert "Date" not in text and "matplotlib.org/" not in text.replace("https://matplotlib.org/", "", 1)
    assert png.read_bytes() == again_png.read_bytes()
    assert svg.read_bytes() == again_svg.read_bytes()


@pytest.mark.parametrize("figure", figures(), ids=lambda figure: figure.name)
def test_a_figure_on_the_screen_is_the_one_in_the_file(figure, tmp_path):
    png, _ = write_figure(figure, tmp_path)
    np.testing.assert_array_equal(pixels_of(figure), cv2.imread(str(png))[..., ::-1])


def _made(folder: Path) -> Path:
    folder.mkdir()
    return folder


def test_the_report_holds_every_sentence_table_and_figure(tmp_path):
    experiment = toy_comparison(knob="system", values=[0.5, 2.0])
    _, summary = run_here(experiment, 5)
    path = write_report(experiment, 5, summary, tmp_path, {"cores": 2})
    text = path.read_text()
    assert text == as_markdown(experiment, 5, summary, {"cores": 2})
    assert text.startswith(f"# {experiment.title}\n")
    assert all(sentence in text for sentence in summary.sentences)
    assert all(f"## {table.title}" in text and (tmp_path / f"{table.name}.csv").is_file() for table in summary.tables)
    assert "comparison.svg" in text
    assert (tmp_path / "comparison.svg").is_file()
    assert "--seeds 5" in text and "cores 2" in text


def test_intervals_make_no_room_and_logarithmic_axes_have_lines_in_them(tmp_path):
    x, y = np.array([1.0, 10.0]), np.array([0.4, 0.6])
    narrow, wide = (Curve("A", x, y, y - reach, y + reach) for reach in (0.0, 900.0))
    images = []
    for curve in (narrow, wide):
        figure = CurveFigure("one", "One", "x", "y", (CurvePanel("", (curve,)),), log_x=True, log_y=True)
        images.append(cv2.imread(str(write_figure(figure, tmp_path)[0])))
    blue = [np.argwhere((image[..., 0] > 150) & (image[..., 2] < 60)) for image in images]
    assert np.ptp(blue[0], axis=0).min() > 100, "the line crosses the picture"
    assert np.abs(np.ptp(blue[0], axis=0) - np.ptp(blue[1], axis=0)).max() < 5
