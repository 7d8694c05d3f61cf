"""``pfviz experiment`` as it is typed."""

from __future__ import annotations

from dataclasses import replace

import pytest
from pfviz_app import commands_experiment
from pfviz_app.cli import build_parser, main
from small_experiments import toy_comparison

from pfviz.experiments.registry import EXPERIMENTS


@pytest.fixture
def tiny(monkeypatch) -> None:
    """``equal-time`` is a small comparison that takes no time."""
    monkeypatch.setitem(EXPERIMENTS, "equal-time", replace(toy_comparison(), seeds=5))


def test_the_results_are_in_the_folder_and_their_report_on_stdout(tiny, tmp_path, capsys):
    main(["experiment", "equal-time", "--out", str(tmp_path / "here"), "--workers", "1"])
    out, err = capsys.readouterr()
    assert out.strip() == str(tmp_path / "here" / "comparison.md")
    assert err == ""
    assert {"comparison.csv", "manifest.json", "rows"} <= {path.name for path in (tmp_path / "here").iterdir()}


def test_the_bar_is_one_line_on_a_terminal(tiny, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    main(["experiment", "equal-time", "--out", str(tmp_path), "--workers", "1", "--seeds", "10"])
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert "4 of 4" in err.split("\r")[-1]


def test_a_stopped_run_says_how_to_go_on(tiny, tmp_path, capsys, monkeypatch):
    def stop(experiment, seeds, results, workers, progress):
        progress(3, 8)
        raise KeyboardInterrupt

    monkeypatch.setattr(commands_experiment, "collect", stop)
    with pytest.raises(SystemExit) as caught:
        main(["experiment", "equal-time", "--out", str(tmp_path)])
    assert caught.value.code == 130
    assert "the same command goes on from 3 of 8" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["equaltime"], "unknown experiment 'equaltime': did you mean 'equal-time'?"),
        (["equal-time", "--seeds", "0"], "--seeds: expected a whole number from 1"),
        (["equal-time", "--workers", "x"], "--workers: expected a whole number from 1"),
        (["equal-time", "--workers", "2", "--scheduler", "tcp://a:1"], "not allowed with argument --workers"),
        (["real-clips"], "PFVIZ_CLIPS"),
        ([], "required: NAME"),
    ],
)
def test_errors_are_one_line(words, complaint, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PFVIZ_CLIPS", raising=False)
    with pytest.raises(SystemExit) as caught:
        main(["experiment", *words])
    assert caught.value.code == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("pfviz: error: ") and err.count("\n") == 1
    assert complaint in err
    assert list(tmp_path.iterdir()) == []


def test_help_names_every_experiment(capsys):
    with pytest.raises(SystemExit):
        build_parser().parse_args(["experiment", "--help"])
    out = "".join(capsys.readouterr().out.split())
    assert ",".join(EXPERIMENTS) in out
