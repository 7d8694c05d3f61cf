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
_unavailable = False


def warm_up() -> None:
    """Compile the kernels, or load them from the disk cache; returns when they are ready.

    Takes some 10 s the first time on a machine and 0.3 s afterwards. Safe to call from any thread, and again.
    """
    global _compiled, _unavailable
    with _lock:
        if _compiled is not None or _unavailable:
            return
        try:
            _compiled = importlib.import_module("pfviz.kernels.compiled")
        except ImportError as error:
            _unavailable = True
            warnings.warn(f"numba cannot be imported ({error}): running in plain NumPy", stacklevel=2)


def compiled_ready() -> bool:
    """Whether a call would run a compiled kernel at once, without waiting for a compilation."""
    return _compiled is not None


def backend() -> Backend:
    """What kernels called from here, in this thread, run on."""
    if _unavailable or _numpy_forced.get() or os.environ.get("PFVIZ_NO_NUMBA", "0") not in ("", "0"):
        return "numpy"
    return "numba"


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
    if backend() == "numba" and _compiled is None:
        warm_up()
    return _compiled if backend() == "numba" else None
