"""One runner for all experiments."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager

from pfviz.experiments.experiment import Experiment, ExperimentError, Job, Row
from pfviz.experiments.results import Results

Workers = Callable[[], AbstractContextManager[Executor]]
_AHEAD = 64
_PATIENCE = 0.2


def finished(
    experiment: Experiment, jobs: Sequence[Job], executor: Executor, check: Callable[[], None] = lambda: None
) -> Iterator[tuple[Job, list[Row]]]:
    """Run ``jobs`` on ``executor`` and yield each with its rows as it ends, in whatever order.

    Of jobs that have ended together those that have failed come last, so that nothing that was done is lost. Closing
    the iterator cancels what has not begun, and so does an exception from ``check``, which is called several times a
    second.

    Raises:
        ExperimentError: if a job fails; the message names it.
    """
    ahead = 1 if experiment.one_at_a_time else _AHEAD
    waiting = iter(jobs)
    running: dict[Future[list[Row]], Job] = {}
    try:
        while True:
            while len(running) < ahead and (job := next(waiting, None)) is not None:
                running[executor.submit(experiment.run, job)] = job
            if not running:
                return
            check()
            done = wait(running, timeout=_PATIENCE, return_when=FIRST_COMPLETED).done
            for future in sorted(done, key=lambda future: future.exception() is not None):
                job = running.pop(future)
                yield job, _rows(future, job)
    finally:
        for future in running:
            future.cancel()


def _rows(future: Future[list[Row]], job: Job) -> list[Row]:
    try:
        return future.result()
    except BrokenProcessPool:
        raise ExperimentError("a worker process ended by itself; run the same command again to go on") from None
    except Exception as error:
        kind = "" if isinstance(error, ValueError) else f"{type(error).__name__}: "
        raise ExperimentError(f"{job.describe()}: {kind}{error}") from error


def collect(
    experiment: Experiment,
    seeds: int,
    results: Results,
    workers: Workers,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> list[Row]:
    """All rows of ``experiment``, in the order of its jobs: those that are stored, and the others after running them.

    Args:
        experiment: what to run.
        seeds: how many.
        results: where rows are stored as soon as their job ends.
        workers: opens the executor; not called when nothing is left to do.
        progress: called with how many jobs are done and how many there are.

    Raises:
        ExperimentError: if the folder of results does not fit, or a job fails.
    """
    jobs = experiment.jobs(seeds)
    results.open(experiment, jobs)
    rows = {job.key: stored for job in jobs if (stored := results.read(job)) is not None}
    left = [job for job in jobs if job.key not in rows]
    progress(len(rows), len(jobs))
    if left:
        with workers() as executor:
            for job, fresh in finished(experiment, left, executor):
                results.write(job, fresh)
                rows[job.key] = fresh
                progress(len(rows), len(jobs))
    return [row for job in jobs for row in rows[job.key]]
