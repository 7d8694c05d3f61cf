"""A real Dask cluster of two processes on this machine gives the tables that the pool gives."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from small_experiments import same_rows, toy_comparison

from pfviz.experiments.experiment import ExperimentError
from pfviz.experiments.measure import exact_run
from pfviz.experiments.report import as_csv
from pfviz.experiments.results import Results
from pfviz.experiments.runner import collect
from pfviz.experiments.workers import cluster, local_workers

ROOT = Path(__file__).resolve().parents[2]
distributed = pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """Of a scheduler with two worker processes."""
    kept = os.environ.get("PYTHONPATH")
    os.environ["PYTHONPATH"] = os.pathsep.join(str(ROOT / part) for part in ("src", "app", "tests"))
    try:
        with distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1"
        ) as local:
            yield local.scheduler_address
    finally:
        if kept is None:
            del os.environ["PYTHONPATH"]
        else:
            os.environ["PYTHONPATH"] = kept


@pytest.mark.filterwarnings("default")
def test_cluster_and_pool_give_the_same_tables(address, tmp_path):
    experiment = toy_comparison(("condensation", "rb-hs-sir", "icondensation"))
    pooled = collect(experiment, 20, Results(tmp_path / "pool"), lambda: local_workers(1))
    told: list[int] = []
    clustered = collect(
        experiment, 20, Results(tmp_path / "cluster"), lambda: cluster(address), lambda done, total: told.append(done)
    )
    assert told == list(range(13))
    assert same_rows(clustered, pooled)
    of_pool, of_cluster = (experiment.summarise(rows).tables[0] for rows in (pooled, clustered))
    assert as_csv(of_cluster) == as_csv(of_pool)
    with distributed.Client(address) as client:
        recordings = client.run(lambda: exact_run.cache_info().misses)
        assert len(recordings) == 2
        assert min(recordings.values()) > 0, "one worker did nothing"


@pytest.mark.filterwarnings("default")
def test_a_job_that_fails_on_the_cluster_is_named(address, tmp_path):
    experiment = toy_comparison(("condensation",), observation=-1.0)
    broken = [*experiment.jobs(5)]
    object.__setattr__(broken[0], "settings", {**broken[0].settings, "filter": "condensatoin"})
    with pytest.raises(ExperimentError, match=r"filter=condensatoin.*unknown filter"), cluster(address) as executor:
        from pfviz.experiments.runner import finished

        list(finished(experiment, broken, executor))


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense", "tcp://127.0.0.1:notaport"])
def test_where_nothing_answers_there_is_one_line(address, monkeypatch):
    monkeypatch.setattr("pfviz.experiments.workers.PATIENCE", "1s")
    with pytest.raises(ExperimentError, match="no Dask scheduler answers at") as caught, cluster(address):
        pass
    assert "\n" not in str(caught.value)
    assert address in str(caught.value)
