"""Where jobs run: processes of this machine, or a Dask cluster, behind the interface of ``concurrent.futures``."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing.connection import Connection

from pfviz.experiments.experiment import ExperimentError

PATIENCE = "10s"
"""How long a scheduler may take to answer."""
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@contextmanager
def local_workers(count: int) -> Iterator[Executor]:
    """``count`` processes of one thread each. They end with the block, at once if it is left by an exception."""
    context = multiprocessing.get_context("spawn")
    lifeline, held = context.Pipe(duplex=False)
    with _one_thread_each(), held, lifeline:
        pool = ProcessPoolExecutor(count, mp_context=context, initializer=_prepare_process, initargs=(lifeline,))
        try:
            yield pool
        except BaseException:
            held.close()
            raise
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def cluster(address: str) -> Iterator[Executor]:
    """The workers of the Dask scheduler at ``address``, such as ``tcp://host:8786``. They must have pfviz installed.

    Raises:
        ExperimentError: if Dask is not installed or nothing answers there.
    """
    try:
        from distributed import Client
    except ImportError:
        raise ExperimentError("a cluster needs Dask: pip install 'pfviz[cluster]'") from None
    try:
        client = Client(address, timeout=PATIENCE)
    except (OSError, ValueError, TypeError) as error:
        raise ExperimentError(f"no Dask scheduler answers at '{address}': {error or type(error).__name__}") from None
    with client:
        if not client.scheduler_info()["workers"]:
            raise ExperimentError(f"the Dask scheduler at '{address}' has no workers")
        client.run(prepare)
        yield client.get_executor(pure=False)


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Workers started inside run their linear algebra in one thread: they share the cores among themselves."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def prepare() -> None:
    """Compile the kernels, or load them from the cache, and keep OpenCV to one thread."""
    import cv2

    from pfviz import kernels

    kernels.warm_up()
    cv2.setNumThreads(1)


def _prepare_process(lifeline: Connection) -> None:
    """In a new worker: interrupts are for the process that started it, and when that one is gone so is this."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(lifeline,), daemon=True).start()
    prepare()


def _end_with(lifeline: Connection) -> None:
    lifeline.poll(None)
    os._exit(1)


def usual_worker_count() -> int:
    """As many as this process may use cores."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
