"""The experiments by name."""

from __future__ import annotations

from pfviz.experiments.equal_time import EQUAL_TIME
from pfviz.experiments.experiment import Experiment
from pfviz.experiments.noise_robustness import NOISE_ROBUSTNESS
from pfviz.experiments.real_clips import REAL_CLIPS
from pfviz.experiments.recovery import RECOVERY
from pfviz.experiments.regime_map import REGIME_MAP
from pfviz.experiments.tracking import LOSS_PROBABILITY, TRACKING_ERROR
from pfviz.experiments.unbiasedness import UNBIASEDNESS
from pfviz.names import find

_ALL = (
    EQUAL_TIME,
    TRACKING_ERROR,
    LOSS_PROBABILITY,
    REGIME_MAP,
    NOISE_ROBUSTNESS,
    RECOVERY,
    UNBIASEDNESS,
    REAL_CLIPS,
)
EXPERIMENTS: dict[str, Experiment] = {experiment.name: experiment for experiment in _ALL}


def get_experiment(name: str) -> Experiment:
    """The experiment called ``name``.

    Raises:
        UnknownName: if there is none; the message suggests the nearest.
    """
    return find(EXPERIMENTS, name, "experiment")
