"""History sampling: log sum_l w_l p(u_i | x_l) and one draw for each of N innovations over N histories.

Clouds are 3 sigma wide, d = 2. The naive version is the one a reader of the paper writes first: whiten,
broadcast, exponentiate, cumulate, compare. Memory is the rise of the process's peak over one call, in a
process of its own.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Callable

import numpy as np
from _timing import interleaved, machine, milliseconds, peak_memory, print_table

from pfviz import kernels

SIZES = (100, 400, 1000, 5000)
DATA_SETS = 7


def naive(innovations, means, log_weights, covariance, uniforms):
    factor = np.linalg.cholesky(covariance)
    inverse = np.linalg.inv(factor).T
    u, m = innovations @ inverse, means @ inverse
    squares = ((u[:, None, :] - m[None, :, :]) ** 2).sum(axis=2)
    constant = 0.5 * u.shape[1] * np.log(2.0 * np.pi) + np.log(np.diag(factor)).sum()
    log_terms = log_weights - 0.5 * squares - constant
    peaks = log_terms.max(axis=1, keepdims=True)
    terms = np.exp(log_terms - peaks)
    totals = terms.sum(axis=1)
    cumulative = np.cumsum(terms / totals[:, None], axis=1)
    return np.log(totals) + peaks[:, 0], (cumulative <= uniforms[:, None]).sum(axis=1)


CONTESTANTS: dict[str, Callable] = {
    "naive NumPy": naive,
    "pfviz NumPy twin": kernels.sample_histories_numpy,
    "pfviz compiled, float64": lambda *a: kernels.sample_histories(*a, precision="float64"),
    "pfviz compiled, float64, 2 threads": lambda *a: kernels.sample_histories(*a, precision="float64", threads=2),
    "pfviz compiled, float32": kernels.sample_histories,
    "pfviz compiled, float32, 2 threads": lambda *a: kernels.sample_histories(*a, threads=2),
}


def problem(n: int, seed: int) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng([n, seed])
    covariance = np.array([[1.0, 0.3], [0.3, 0.5]])
    factor = np.linalg.cholesky(covariance)
    u, m = 3.0 * rng.normal(size=(2, n, 2)) @ factor.T
    return u, m, np.log(rng.dirichlet(np.ones(n))), covariance, rng.random(n)


def extra_memory(name: str, n: int) -> str:
    done = subprocess.run(
        [sys.executable, __file__, "--memory", name, str(n)], capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


def print_memory(name: str, n: int) -> None:
    kernels.warm_up()
    CONTESTANTS[name](*problem(10, 0))
    arguments = problem(n, 0)
    before = peak_memory()
    CONTESTANTS[name](*arguments)
    print(f"{(peak_memory() - before) / 2**20:.1f} MiB" if before else "unknown")


def main() -> None:
    kernels.warm_up()
    print(machine())
    medians: dict[int, dict[str, float]] = {}
    for n in SIZES:
        problems = [problem(n, seed) for seed in range(DATA_SETS)]
        exact = kernels.sample_histories_numpy(*problems[0])
        for run in CONTESTANTS.values():
            np.testing.assert_allclose(run(*problems[0])[0], exact[0], atol=1e-4)
        medians[n] = interleaved(CONTESTANTS, problems, rounds=60 if n < 5000 else 7)
    rows = []
    for name in CONTESTANTS:
        times = [
            f"{milliseconds(medians[n][name])} ({medians[n]['naive NumPy'] / medians[n][name]:.0f}x)" for n in SIZES
        ]
        rows.append([name, *times, extra_memory(name, SIZES[-1])])
    columns = ["", *(f"N = {n}" for n in SIZES), f"extra memory at {SIZES[-1]}"]
    print_table("History sampling: median time (times as fast as naive)", columns, rows)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--memory", nargs=2, metavar=("CONTESTANT", "N"), help="print the memory that one call takes")
    options = parser.parse_args()
    if options.memory:
        print_memory(options.memory[0], int(options.memory[1]))
    else:
        main()
