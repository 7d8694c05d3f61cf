"""Side-by-side timing: medians over interleaved rounds in one process, as a Markdown table."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from statistics import median

import numba
import numpy as np


def machine() -> str:
    """What the numbers were measured on."""
    processor = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        names = [line.split(":")[1].strip() for line in info.read_text().splitlines() if line.startswith("model name")]
        processor = names[0] if names else processor
    load = f", load {os.getloadavg()[0]:.1f} at the start" if hasattr(os, "getloadavg") else ""
    return (
        f"{processor}, {os.cpu_count()} cores{load}; Python {platform.python_version()}, "
        f"NumPy {np.__version__}, numba {numba.__version__}"
    )


def interleaved(
    contestants: Mapping[str, Callable[..., object]],
    data: Sequence[tuple],
    rounds: int,
    seconds: float = 20.0,
) -> dict[str, float]:
    """Median seconds a call, each round calling every contestant once, after a round that does not count.

    A round takes the next of ``data`` as arguments, so that no call sees the data of the call before. Stops
    early, but not before three rounds, when ``seconds`` are over.
    """
    times: dict[str, list[float]] = {name: [] for name in contestants}
    began = time.perf_counter()
    for turn in range(rounds + 1):
        for name, run in contestants.items():
            arguments = data[turn % len(data)]
            start = time.perf_counter()
            run(*arguments)
            if turn:
                times[name].append(time.perf_counter() - start)
        if turn >= 3 and time.perf_counter() - began > seconds:
            break
    return {name: median(values) for name, values in times.items()}


def peak_memory() -> int:
    """The largest resident memory of this process so far, in bytes; 0 where the system does not tell."""
    status = Path("/proc/self/status")
    if status.exists():
        lines = [line for line in status.read_text().splitlines() if line.startswith("VmHWM")]
        return int(lines[0].split()[1]) * 1024
    return 0


def print_table(title: str, columns: list[str], rows: list[list[str]]) -> None:
    print(f"\n**{title}**\n")
    print("| " + " | ".join(columns) + " |")
    print("|" + "|".join("---" if i == 0 else "---:" for i in range(len(columns))) + "|")
    for row in rows:
        print("| " + " | ".join(row) + " |")


def milliseconds(seconds: float) -> str:
    return f"{seconds * 1e3:.3g} ms"
