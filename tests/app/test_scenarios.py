"""The gallery: what the sentences claim is there, as paired statistics over many seeds and in the films shown."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from pfviz_app.scenarios import SCENARIOS, Scenario, find_scenario
from pfviz_app.settings import CONTROLS, Settings

from pfviz.filters import make_filter
from pfviz.names import UnknownName
from pfviz.record import StepRecord
from pfviz.running import run
from pfviz.worlds import get_world

every_scenario = pytest.mark.parametrize("scenario", SCENARIOS.values(), ids=list(SCENARIOS))


@dataclass(frozen=True)
class Frame:
    """A step, the truth, and the exact posterior where it was asked for."""

    record: StepRecord
    truth: np.ndarray
    exact_variance: float = np.nan

    @property
    def error(self) -> float:
        return float(np.linalg.norm(self.record.estimate - self.truth))

    @property
    def ess_share(self) -> float:
        return self.record.effective_sample_size / len(self.record.posterior)


Film = list[Frame]


def film(settings: Settings, filter_name: str, seed: int, steps: int, exact: bool = False) -> Film:
    world = get_world(settings.world)
    model = world.model.with_noise(settings.system, settings.observation, settings.proposal)
    recording = world.record(seed, steps)
    records = run(make_filter(filter_name, settings.toy_particles), model, recording.observations, seed)
    frames, state = [], model.prior
    for record, truth in zip(records, recording.truth, strict=True):
        step = model.exact_step(state, record.observation) if exact else None
        if step is None:
            frames.append(Frame(record, truth))
        else:
            state = step.posterior
            frames.append(Frame(record, truth, float(state.leading(1).covariance[0, 0])))
    return frames


def mean_ess(frames: Film) -> float:
    return float(np.mean([frame.ess_share for frame in frames]))


def mean_error(frames: Film) -> float:
    return float(np.mean([frame.error for frame in frames]))


def rms_error(frames: Film) -> float:
    return float(np.sqrt(np.mean([frame.error**2 for frame in frames])))


def ruled_by_one(frames: Film) -> float:
    """The share of steps in which one particle has more than half of the weight."""
    heaviest = [stage.particles.weights.max() for frame in frames if (stage := frame.record.stage("weight"))]
    return float(np.mean(np.array(heaviest) > 0.5))


def strayed(frames: Film) -> float:
    """The share of steps in which the estimate is four deviations of the observation noise from the target."""
    return float(np.mean([frame.error > 0.6 for frame in frames]))


def steps_to_recover(frames: Film) -> float:
    """From the jump at t = 25 until the estimate is within two deviations of the observation noise."""
    near = [frame.error < 0.6 for frame in frames[24:]]
    return float(near.index(True)) if True in near else float(len(near))


def one_mode_is_dead(frames: Film) -> float:
    """The share of steps in which one of the two signs has less than a fiftieth of the weight."""
    positive = [frame.record.posterior.weights[frame.record.posterior.innovation[:, 0] > 0].sum() for frame in frames]
    return float(np.mean(np.minimum(positive, 1 - np.array(positive)) < 0.02))


def too_wide(frames: Film) -> float:
    """The mean ratio of the cloud's variance and the exact one."""
    return float(np.mean([frame.record.posterior.covariance[0, 0] / frame.exact_variance for frame in frames]))


@dataclass(frozen=True)
class Claim:
    """What is larger for the filter than for its rival.

    Attributes:
        statistic: of a film.
        seeds: how many films.
        steps: how long they are.
        skip: how many steps at the beginning are not looked at.
        factor: how many times as large it is at least, on the mean.
        sign: -1 if it is smaller; ``factor`` is then of the rival.
        exact: whether the exact posterior is needed.
    """

    statistic: Callable[[Film], float]
    seeds: int
    steps: int
    skip: int = 0
    factor: float = 1.0
    sign: int = 1
    exact: bool = False

    def values(self, scenario: Scenario, filter_name: str, seeds: range | None = None) -> np.ndarray:
        films = (
            film(scenario.settings, filter_name, seed, self.steps, self.exact) for seed in seeds or range(self.seeds)
        )
        return np.array([self.statistic(frames[self.skip :]) for frames in films])


CLAIMS = {
    "arbitrary-associations": [Claim(mean_ess, 10, 15, factor=2.5, sign=-1)],
    "degenerate-weights": [Claim(ruled_by_one, 12, 15, factor=3.0)],
    "peaked-likelihood": [
        Claim(mean_ess, 10, 12, factor=1.7, sign=-1),
        Claim(mean_error, 24, 15, factor=1.2),
    ],
    "wrong-noise": [Claim(rms_error, 12, 40, factor=1.2)],
    "look-alike": [Claim(mean_ess, 6, 20, factor=2.5, sign=-1), Claim(strayed, 60, 40, factor=2.0)],
    "occlusion": [Claim(mean_ess, 12, 63, skip=62, factor=4.0, sign=-1)],
    "jump": [Claim(steps_to_recover, 12, 40, factor=2.5)],
    "dying-modes": [Claim(one_mode_is_dead, 40, 40, factor=2.0)],
    "icondensation-bias": [Claim(too_wide, 5, 10, skip=3, factor=1.8, exact=True)],
}
PAIRS = [(name, claim) for name, claims in CLAIMS.items() for claim in claims]


def t_value(differences: np.ndarray) -> float:
    return float(differences.mean() / (differences.std(ddof=1) / np.sqrt(len(differences))))


@pytest.mark.parametrize(("name", "claim"), PAIRS, ids=[f"{name}-{c.statistic.__name__}" for name, c in PAIRS])
def test_the_effect_is_there(name, claim):
    """Films of a pair share their data and random numbers, so that their differences are what is looked at."""
    scenario = SCENARIOS[name]
    own = claim.values(scenario, scenario.settings.filter)
    rival = claim.values(scenario, scenario.settings.rival)
    assert t_value(claim.sign * (own - rival)) > 3.0
    large, small = (own, rival) if claim.sign > 0 else (rival, own)
    assert large.mean() > claim.factor * small.mean()


def test_every_situation_has_a_claim():
    assert set(CLAIMS) == set(SCENARIOS)


@every_scenario
def test_the_film_that_is_shown_shows_it(scenario):
    """At the time that is gone to and in the steps that follow."""
    claim = CLAIMS[scenario.name][0]
    start = scenario.t or 0
    shown = Claim(claim.statistic, 1, max(start + 10, claim.steps), exact=claim.exact)
    part = slice(start, start + 1) if scenario.name == "occlusion" else slice(max(start - 1, 0), start + 10)
    part = slice(None) if claim.statistic is steps_to_recover else part
    values = []
    for name in (scenario.settings.filter, scenario.settings.rival):
        frames = film(scenario.settings, name, scenario.settings.seed, shown.steps, shown.exact)
        values.append(claim.statistic(frames[part]))
    assert claim.sign * (values[0] - values[1]) > 0.25 * abs(values[0])


@every_scenario
def test_a_situation_can_be_set(scenario):
    for field in ("world", "filter", "rival", "toy_particles", "tracker_particles", "system", "seed"):
        value = getattr(scenario.settings, field)
        assert CONTROLS[field].checked(value) == value
    assert scenario.settings.rival not in ("none", scenario.settings.filter)
    assert scenario.t is None or 0 < scenario.t <= 100
    assert scenario.title and scenario.look_for[-1] == "." and len(scenario.look_for) < 260
    assert find_scenario(scenario.name) is scenario


def test_a_situation_that_there_is_not():
    with pytest.raises(UnknownName, match="unknown scenario 'jumps': did you mean 'jump'"):
        find_scenario("jumps")
