"""Experiments in the background: rows as they come, an end that is told, and a stop."""

from __future__ import annotations

import threading
import time
from dataclasses import replace

import pytest
from small_experiments import run_here, same_rows, toy_comparison

from pfviz.experiments import LiveExperiment, Progress, comparison, plain_arms
from pfviz.experiments.experiment import ExperimentError, Job, Row, blocks
from pfviz.experiments.report import as_csv


def test_rows_come_as_jobs_end_and_are_those_of_the_experiment():
    experiment = toy_comparison(knob="particles", values=[10, 40])
    told: list[Progress] = []
    live = LiveExperiment(experiment, 10, told.append, workers=0)
    last = live.wait(300)
    assert last.state == "finished"
    assert [progress.done for progress in told] == [*range(9), 8]
    assert [progress.state for progress in told] == ["running"] * 9 + ["finished"]
    assert told[4].share == 0.5
    assert [len(progress.rows) for progress in told[:-1]] == [5 * done for done in range(9)]
    rows, summary = run_here(experiment, 10)
    assert same_rows(last.rows, rows)
    assert as_csv(live.summary.tables[0]) == as_csv(summary.tables[0])


def test_a_process_of_its_own_gives_the_same():
    experiment = toy_comparison()
    rows, _ = run_here(experiment, 5)
    live = LiveExperiment(experiment, 5, workers=1)
    assert same_rows(live.wait(300).rows, rows)


def test_cancelling_ends_a_job_that_runs_in_a_process():
    begun = threading.Event()
    settings = {"place": "linear-gaussian", "label": "", "filter": "condensation", "particles": 10}
    jobs = [Job({**settings, "steps": steps}, (0,)) for steps in (5, 10_000_000)]
    experiment = replace(toy_comparison(), jobs=lambda seeds: jobs)
    live = LiveExperiment(experiment, 1, lambda progress: begun.set() if progress.done else None)
    assert begun.wait(300)
    live.cancel()
    last = live.wait(300)
    assert last.state == "cancelled"
    assert last.done == 1
    assert len(last.rows) == 1


def test_cancelling_in_a_thread_starts_no_further_job():
    def tell(progress: Progress) -> None:
        if progress.done == 2:
            live.cancel()

    ready = threading.Event()
    experiment = toy_comparison()
    runs: list[int] = []

    def run(job: Job) -> list[Row]:
        ready.wait(300)
        runs.append(job.seeds[0])
        time.sleep(0.05)
        return [{"seed": job.seeds[0]}]

    live = LiveExperiment(replace(experiment, run=run, jobs=lambda seeds: blocks([{}], seeds, 1)), 50, tell, workers=0)
    ready.set()
    assert live.wait(300).state == "cancelled"
    assert len(runs) < 10


def test_a_failure_is_told_in_one_line():
    told: list[Progress] = []
    live = LiveExperiment(comparison("mars", plain_arms(["condensation"], 10)), 1, told.append, workers=0)
    assert live.wait(300).state == "failed"
    assert told[-1] == live.progress
    assert "unknown world 'mars'" in (told[-1].error or "")
    assert "\n" not in (told[-1].error or "")


def test_sentences_of_a_comparison_follow_the_rows():
    def row(label: str, seed: int, error: float) -> Row:
        named = {"place": "plane", "label": label, "filter": "x", "seed": seed, "system": 1.0}
        return {**named, "error": error, "tracked": 1, "ess_share": 0.5, "milliseconds": 1.0}

    experiment = comparison("plane", plain_arms(["condensation", "basic-sir"], 10), "system", [1.0])
    apart = [row(label, s, base + 0.01 * s) for s in range(8) for label, base in (("A", 1.0), ("B", 2.0), ("C", 0.5))]
    b, c = experiment.summarise(apart).sentences
    assert "B has a greater error than A" in b
    assert "C has a smaller error than A" in c
    alike = [row(label, s, (s * 7 + i * 3) % 5) for s in range(8) for i, label in enumerate("AB")]
    assert "cannot tell" in experiment.summarise(alike).sentences[0]


def test_a_knob_that_there_is_not_and_no_filters_are_refused():
    with pytest.raises(ExperimentError, match=r"knob: expected one of particles, system, .* got 'speed'"):
        comparison("plane", plain_arms(["condensation"], 10), "speed", [1.0])
    with pytest.raises(ExperimentError, match="at least one filter"):
        comparison("plane", [])
