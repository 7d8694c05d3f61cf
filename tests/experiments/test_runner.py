"""Results that survive: killed runs go on, nothing is mixed, what is damaged is done again."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest
from small_experiments import same_rows, toy_comparison

from pfviz.experiments.experiment import Experiment, ExperimentError, Job, Row, blocks
from pfviz.experiments.report import as_csv
from pfviz.experiments.results import Results, machine
from pfviz.experiments.runner import collect, finished
from pfviz.experiments.workers import local_workers

ROOT = Path(__file__).resolve().parents[2]
SEEDS = 25


def one_thread() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(1)


def no_workers():
    raise AssertionError("nothing was left to run")


def collected(experiment: Experiment, folder: Path, seeds: int = 10, workers=one_thread) -> list[Row]:
    return collect(experiment, seeds, Results(folder), workers)


def reproducible_tables(experiment: Experiment, rows: list[Row]) -> dict[str, str]:
    """All tables as CSV but that of processor time."""
    return {table.name: as_csv(table) for table in experiment.summarise(rows).tables if table.name != "processor-time"}


def shards(folder: Path) -> list[Path]:
    return sorted((folder / "rows").glob("*.jsonl"))


def test_every_row_has_its_seed_and_settings_and_every_job_its_file(tmp_path):
    experiment = toy_comparison(system=2.0)
    rows = collected(experiment, tmp_path)
    assert len(shards(tmp_path)) == len(experiment.jobs(10)) == 4
    stored = [json.loads(line) for path in shards(tmp_path) for line in path.read_text().splitlines()]
    assert sorted(map(str, stored)) == sorted(map(str, rows))
    assert {(row["filter"], row["seed"]) for row in rows} == {
        (name, seed) for name in ("condensation", "rb-hs-sir") for seed in range(10)
    }
    assert {(row["system"], row["steps"], row["particles"]) for row in rows} == {(2.0, 10, 20)}


def test_what_is_stored_is_not_run_again_and_more_seeds_go_on_from_it(tmp_path):
    experiment = toy_comparison()
    first = collected(experiment, tmp_path, 5)
    assert collected(experiment, tmp_path, 5, no_workers) == first
    more = collected(experiment, tmp_path, 10)
    assert [row for row in more if row["seed"] < 5] == first
    assert len(more) == 20


def test_what_is_damaged_is_run_again(tmp_path):
    experiment = toy_comparison()
    rows = collected(experiment, tmp_path)
    paths = shards(tmp_path)
    paths[0].write_text(paths[0].read_text()[:-20])
    paths[1].write_text("".join(paths[1].read_text().splitlines(keepends=True)[:-1]))
    paths[2].unlink()
    assert same_rows(collected(experiment, tmp_path), rows)


def test_a_failed_write_leaves_nothing_behind(tmp_path, monkeypatch):
    results, (job, *_) = Results(tmp_path), toy_comparison().jobs(5)
    results.open(toy_comparison(), [job])

    def fail(*_arguments):
        raise OSError("disk full")

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(OSError, match="disk full"):
        results.write(job, [{"seed": 0}])
    assert list((tmp_path / "rows").iterdir()) == []
    assert results.read(job) is None


@pytest.mark.parametrize(
    ("other", "complaint"),
    [
        (toy_comparison(system=3.0), "other settings or another version"),
        (replace(toy_comparison(), version=2), "other settings or another version"),
        (replace(toy_comparison(), rows_of="something"), "holds rows of 'comparison', not of 'something'"),
    ],
)
def test_rows_of_something_else_are_not_mixed_in(tmp_path, other, complaint):
    collected(toy_comparison(), tmp_path, 1)
    with pytest.raises(ExperimentError, match=complaint) as caught:
        collected(other, tmp_path, 1, no_workers)
    assert "\n" not in str(caught.value)
    assert "--out" in str(caught.value)


def test_changed_code_does_not_go_on_in_the_same_folder(tmp_path, monkeypatch):
    collected(toy_comparison(), tmp_path, 1)
    monkeypatch.setattr("pfviz.experiments.results.code_digest", lambda: "another")
    with pytest.raises(ExperimentError, match="another version of pfviz"):
        collected(toy_comparison(), tmp_path, 1, no_workers)


def test_a_folder_of_something_else_is_left_alone(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ExperimentError, match="cannot hold results"):
        collected(toy_comparison(), tmp_path / "file" / "below", 1, no_workers)
    (tmp_path / "manifest.json").write_text("not JSON")
    with pytest.raises(ExperimentError, match="is not a manifest"):
        collected(toy_comparison(), tmp_path, 1, no_workers)


def test_the_manifest_names_the_machine(tmp_path):
    collected(toy_comparison(), tmp_path, 1)
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    assert manifest["machine"] == machine()
    assert manifest["machine"]["cores"] == os.cpu_count()


def test_a_job_that_fails_is_named_and_what_was_done_is_kept(tmp_path):
    experiment = toy_comparison()
    broken = replace(experiment, jobs=lambda seeds: [*experiment.jobs(5), Job({"place": "mars", "filter": "x"}, (3,))])
    with pytest.raises(ExperimentError, match="place=mars, filter=x, seeds 3") as caught:
        collected(broken, tmp_path)
    assert "\n" not in str(caught.value)
    assert len(shards(tmp_path)) == 2


def test_one_at_a_time_means_it():
    running: list[int] = []
    most: list[int] = []

    def busy(job: Job) -> list[Row]:
        running.append(1)
        most.append(len(running))
        time.sleep(0.02)
        running.pop()
        return [{"seed": seed} for seed in job.seeds]

    jobs = blocks([{}], 8, 1)
    for alone in (True, False):
        most.clear()
        experiment = replace(toy_comparison(), run=busy, jobs=lambda seeds: jobs, one_at_a_time=alone)
        with ThreadPoolExecutor(4) as executor:
            assert len(list(finished(experiment, jobs, executor))) == 8
        assert (max(most) == 1) is alone


PROGRAM = """
import os, signal, sys
from pathlib import Path
from pfviz.experiments import Results, collect, local_workers
from small_experiments import toy_comparison

def die_after_three(done, total):
    if done == 3:
        os.kill(os.getpid(), signal.SIGKILL)

if __name__ == "__main__":
    folder, seeds = Path(sys.argv[1]), int(sys.argv[2])
    collect(toy_comparison(), seeds, Results(folder), lambda: local_workers(2), die_after_three)
"""


def start(folder: Path, program: Path) -> subprocess.Popen:
    program.write_text(PROGRAM)
    path = os.pathsep.join(str(ROOT / part) for part in ("src", "app", "tests"))
    return subprocess.Popen(
        [sys.executable, program, folder, str(SEEDS)], env=os.environ | {"PYTHONPATH": path}, start_new_session=True
    )


def group_is_gone(group: int) -> bool:
    """Whether no process of a process group is left, zombies aside."""
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, of_group = stat.read_text().rpartition(")")[2].split()[:3]
        except OSError:
            continue
        if int(of_group) == group and state != "Z":
            return False
    return True


def wait_until(condition, seconds: float = 300.0) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.01)


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks for processes in /proc")
def test_a_run_that_is_killed_leaves_no_process_and_goes_on_to_the_same_tables(tmp_path):
    experiment, folder = toy_comparison(), tmp_path / "killed"
    process = start(folder, tmp_path / "program.py")
    assert process.wait(300) == -signal.SIGKILL
    assert len(shards(folder)) == 3 < len(experiment.jobs(SEEDS))
    wait_until(lambda: group_is_gone(process.pid))

    kept = {path.name: path.read_text() for path in shards(folder)}
    rows = collected(experiment, folder, SEEDS)
    assert {name: (folder / "rows" / name).read_text() for name in kept} == kept
    whole = collected(experiment, tmp_path / "whole", SEEDS)
    assert same_rows(rows, whole)
    assert reproducible_tables(experiment, rows) == reproducible_tables(experiment, whole)


def test_leaving_the_pool_by_an_exception_ends_its_processes_at_once():
    began = time.monotonic()
    with pytest.raises(RuntimeError, match="enough"), local_workers(1) as executor:
        assert executor.submit(os.getpid).result() != os.getpid()
        slow = executor.submit(time.sleep, 600)
        wait_until(slow.running)
        raise RuntimeError("enough")
    assert time.monotonic() - began < 500
