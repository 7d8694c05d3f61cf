"""Which implementation runs: the compiled kernels or their NumPy twins."""

from __future__ import annotations

import importlib
import os
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from types import ModuleType
from typing import Literal

Backend = Literal["numba", "numpy"]

_numpy_forced = ContextVar("numpy_forced", default=False)
_lock = threading.Lock()
_compiled: ModuleType | None = None
_numba_wanted = os.environ.get("PFVIZ_NO_NUMBA", "") in ("", "0")


def warm_up() -> None:
    """Compile the kernels, or load them from the disk cache; returns when they are ready.

    Takes ten to twenty seconds the first time on a machine and a third of a second afterwards. Safe to call from
    any thread, and again. Does nothing where the backend is NumPy.
    """
    global _compiled, _numba_wanted
    with _lock:
        if _compiled is not None or not _numba_wanted:
            return
        try:
            _compiled = importlib.import_module("pfviz.kernels.compiled")
        except ImportError as error:
            _numba_wanted = False
            warnings.warn(f"numba cannot be imported ({error}): running in plain NumPy", stacklevel=2)


def compiled_ready() -> bool:
    """Whether the compiled kernels are there, so that no call waits for a compilation."""
    return _compiled is not None


def backend() -> Backend:
    """What kernels called from here, in this thread, run on."""
    return "numba" if _numba_wanted and not _numpy_forced.get() else "numpy"


@contextmanager
def use_numpy() -> Iterator[None]:
    """Run the NumPy twins inside the ``with`` block, in this thread only."""
    token = _numpy_forced.set(True)
    try:
        yield
    finally:
        _numpy_forced.reset(token)


def compiled() -> ModuleType | None:
    """The module of compiled kernels, compiling it if need be; None where the twins are to run."""
    if not _numba_wanted or _numpy_forced.get():
        return None
    if _compiled is None:
        warm_up()
    return _compiled
