"""Experiments beside a program that goes on: in the background, with the rows so far, and a way to stop.

arms = plain_arms(["condensation", "rb-ss-hs-sir"], particles=400)
live = LiveExperiment(comparison("scene:twin", arms), seeds=5, on_progress=show)
...
live.cancel()
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import AbstractContextManager
from dataclasses import dataclass

from pfviz.experiments.experiment import Experiment, ExperimentError, Row
from pfviz.experiments.runner import Workers, finished
from pfviz.experiments.summary import Summary
from pfviz.experiments.workers import local_workers


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a live experiment has come.

    Attributes:
        rows: those of the jobs that have ended, in the order of the jobs.
        done: how many jobs that is.
        total: how many there are.
        state: "running", "finished", "cancelled" or "failed".
        error: one line, where it has failed.
    """

    rows: tuple[Row, ...]
    done: int
    total: int
    state: str = "running"
    error: str | None = None

    @property
    def share(self) -> float:
        """The part that is done, from 0 to 1."""
        return self.done / self.total if self.total else 1.0


class LiveExperiment:
    """An experiment that runs in the background and stores nothing.

    It begins when it is made. ``on_progress`` is called from its own thread: at the beginning, whenever a job has
    ended, and a last time with a state other than "running". An exception in it ends the run as failed.

    Args:
        experiment: what to run.
        seeds: how many; those of the full size by default.
        on_progress: what to tell.
        workers: processes to run on. With 0 the jobs run in a thread of this process, which starts at once but shares
            the interpreter with whatever else runs there.
    """

    def __init__(
        self,
        experiment: Experiment,
        seeds: int | None = None,
        on_progress: Callable[[Progress], None] = lambda progress: None,
        workers: int = 1,
    ) -> None:
        self._experiment = experiment
        self._jobs = list(experiment.jobs(experiment.seeds if seeds is None else seeds))
        self._on_progress = on_progress
        self._workers = one_thread if workers == 0 else (lambda: local_workers(workers))
        self._cancelled = threading.Event()
        self._progress = Progress((), 0, len(self._jobs))
        self._thread = threading.Thread(target=self._run, name=f"experiment {experiment.name}", daemon=True)
        self._thread.start()

    @property
    def progress(self) -> Progress:
        """The newest."""
        return self._progress

    @property
    def summary(self) -> Summary:
        """Tables, figures and sentences from the rows so far."""
        return self._experiment.summarise(self._progress.rows)

    def cancel(self) -> None:
        """Stop: jobs that run are ended with their processes, or let end where they run in a thread."""
        self._cancelled.set()

    def wait(self, timeout: float | None = None) -> Progress:
        """Wait for the end, for ``timeout`` seconds at the most; how far it has come."""
        self._thread.join(timeout)
        return self._progress

    def _run(self) -> None:
        try:
            self._on_progress(self._progress)
            self._collect(self._workers)
            self._tell(self._progress.rows, self._progress.done, "finished")
        except _Cancelled:
            self._tell(self._progress.rows, self._progress.done, "cancelled")
        except Exception as error:
            self._progress = Progress(
                self._progress.rows, self._progress.done, len(self._jobs), "failed", " ".join(str(error).split())
            )
            self._on_progress(self._progress)
            if not isinstance(error, ExperimentError):
                raise

    def _collect(self, workers: Workers) -> None:
        rows: dict[str, list[Row]] = {}
        with workers() as executor:
            for job, fresh in finished(self._experiment, self._jobs, executor, self._stop_if_cancelled):
                rows[job.key] = fresh
                in_order = tuple(row for each in self._jobs for row in rows.get(each.key, ()))
                self._tell(in_order, len(rows), "running")

    def _stop_if_cancelled(self) -> None:
        if self._cancelled.is_set():
            raise _Cancelled

    def _tell(self, rows: tuple[Row, ...], done: int, state: str) -> None:
        self._progress = Progress(rows, done, len(self._jobs), state)
        self._on_progress(self._progress)


class _Cancelled(Exception):
    pass


def one_thread() -> AbstractContextManager[Executor]:
    """An executor of one thread of this process."""
    return ThreadPoolExecutor(1, thread_name_prefix="experiment")
