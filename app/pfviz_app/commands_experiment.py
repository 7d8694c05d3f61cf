"""``pfviz experiment``: many runs as tables, figures and a report; it goes on where it was stopped."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from pfviz.experiments.experiment import Experiment
from pfviz.experiments.registry import get_experiment
from pfviz.experiments.report import write_report
from pfviz.experiments.results import Results, machine
from pfviz.experiments.runner import Workers, collect
from pfviz.experiments.workers import cluster, local_workers, usual_worker_count


def run_experiment(options: argparse.Namespace) -> None:
    """Run the command."""
    experiment = get_experiment(options.name)
    seeds = options.seeds or experiment.seeds
    results = Results(Path(options.out or f"results/{experiment.origin}"))
    bar = ProgressBar(experiment)
    try:
        rows = collect(experiment, seeds, results, _workers(options), bar.show)
    except KeyboardInterrupt:
        bar.end()
        print(f"pfviz: stopped; the same command goes on from {bar.done} of {bar.total}", file=sys.stderr)
        raise
    except ValueError:
        bar.end()
        raise
    bar.end()
    print(write_report(experiment, seeds, experiment.summarise(rows), results.folder, machine()))


def _workers(options: argparse.Namespace) -> Workers:
    if options.scheduler is not None:
        return lambda: cluster(options.scheduler)
    return lambda: local_workers(options.workers or usual_worker_count())


class ProgressBar:
    """One line on stderr, where that is a terminal: what is done, and how long the rest will take."""

    def __init__(self, experiment: Experiment) -> None:
        self.done = self.total = 0
        self._name = experiment.name
        self._stored: int | None = None
        self._began = time.monotonic()
        self._on = sys.stderr.isatty()

    def show(self, done: int, total: int) -> None:
        """Draw the line anew."""
        self._stored = done if self._stored is None else self._stored
        self.done, self.total = done, total
        if self._on:
            bar = "█" * round(24 * done / max(total, 1))
            print(f"\r{self._name} {bar:░<24} {done} of {total}{self._rest():<24}", end="", file=sys.stderr, flush=True)

    def _rest(self) -> str:
        fresh = self.done - (self._stored or 0)
        if not fresh or self.done == self.total:
            return ""
        seconds = (time.monotonic() - self._began) / fresh * (self.total - self.done)
        return f"  {seconds / 60:.0f} min left" if seconds > 90 else f"  {seconds:.0f} s left"

    def end(self) -> None:
        """Leave the line."""
        if self._on and self.total:
            print(file=sys.stderr)
