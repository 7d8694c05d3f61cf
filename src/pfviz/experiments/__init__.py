"""Many runs, many settings: tables, figures, and sentences that follow from them."""

from pfviz.experiments.cells import Arm, plain_arms
from pfviz.experiments.comparison import KNOBS, comparison
from pfviz.experiments.experiment import Experiment, ExperimentError, Job, Row
from pfviz.experiments.live import LiveExperiment, Progress
from pfviz.experiments.registry import EXPERIMENTS, get_experiment
from pfviz.experiments.report import write_report
from pfviz.experiments.results import Results
from pfviz.experiments.runner import collect
from pfviz.experiments.small import get_small_experiment
from pfviz.experiments.summary import Summary, Table
from pfviz.experiments.workers import cluster, local_workers

__all__ = [
    "EXPERIMENTS",
    "KNOBS",
    "Arm",
    "Experiment",
    "ExperimentError",
    "Job",
    "LiveExperiment",
    "Progress",
    "Results",
    "Row",
    "Summary",
    "Table",
    "cluster",
    "collect",
    "comparison",
    "get_experiment",
    "get_small_experiment",
    "local_workers",
    "plain_arms",
    "write_report",
]
