"""One bootstrap step (systematic resampling, propagation, likelihood, normalisation, posterior mean), beside
other packages.

The model is a random walk observed in noise: x' = x + w, y = x + v. Every contestant resamples at every step,
in double precision where it lets one choose, and must follow the Kalman filter before its time counts.
Packages that do not import are named.
"""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable
from datetime import datetime, timedelta

import numpy as np
from _timing import interleaved, machine, milliseconds, print_table

from pfviz import kernels

os.environ.setdefault("JAX_ENABLE_X64", "1")

SIZES = (1_000, 10_000, 100_000, 1_000_000)
WALK, NOISE = 0.7, 1.2
Step = Callable[[float], float]  # an observation in, the posterior mean out


def log_likelihood(x, y):
    return -0.5 * ((y - x) / NOISE) ** 2


def pfviz_kernels(n: int) -> Step:
    walk, still, noise = np.ones((1, 1, 1)), np.zeros(1), np.full((1, 1), WALK)
    rng = np.random.default_rng(1)
    state = {"x": rng.normal(size=(n, 1, 1)), "weights": np.full(n, 1.0 / n)}

    def step(y: float) -> float:
        ancestors = kernels.systematic_ancestors(state["weights"], rng.random())
        seed = int(rng.integers(2**63))
        x = kernels.propagate(state["x"], ancestors, walk, still, noise, seed)
        weights = kernels.normalise_log_weights(log_likelihood(x[:, 0, 0], y)).weights
        state.update(x=x, weights=weights)
        return float(weights @ x[:, 0, 0])

    return step


def pfviz_condensation(n: int) -> Step:
    """The library's filter, which records every stage of the step."""
    from pfviz.dynamics import Autoregression
    from pfviz.filters import Condensation

    class Model:
        dynamics = Autoregression.scalar([1.0], WALK)

        def sample_prior(self, rng, count):
            return rng.normal(size=(count, 1, 1))

        def log_likelihood(self, innovation, observation):
            return log_likelihood(innovation[:, 0], observation)

    condensation, rng, model = Condensation(n), np.random.default_rng(1), Model()
    state = {"particles": condensation.initial(rng, model)}

    def step(y: float) -> float:
        record = condensation.step(np.random.default_rng(rng.integers(2**63)), model, state["particles"], y)
        state["particles"] = record.posterior
        return float(record.posterior.mean[0])

    return step


def plain_numpy(n: int) -> Step:
    rng = np.random.default_rng(1)
    state = {"x": rng.normal(size=n), "weights": np.full(n, 1.0 / n)}

    def step(y: float) -> float:
        points = (np.arange(n) + rng.random()) / n
        ancestors = np.minimum(np.searchsorted(np.cumsum(state["weights"]), points), n - 1)
        x = state["x"][ancestors] + WALK * rng.standard_normal(n)
        log_weights = log_likelihood(x, y)
        weights = np.exp(log_weights - log_weights.max())
        weights /= weights.sum()
        state.update(x=x, weights=weights)
        return float(weights @ x)

    return step


def particles(n: int) -> Step:
    import particles as package
    from particles import distributions, state_space_models

    class Walk(state_space_models.StateSpaceModel):
        def PX0(self):
            return distributions.Normal()

        def PX(self, t, xp):
            return distributions.Normal(loc=xp, scale=WALK)

        def PY(self, t, xp, x):
            return distributions.Normal(loc=x, scale=NOISE)

    class Endless(list):
        """One observation after another, without an end."""

        def __len__(self) -> int:
            return 10**9

        def __getitem__(self, _):
            return observed["y"]

    observed = {"y": 0.0}
    model = state_space_models.Bootstrap(ssm=Walk(), data=Endless())
    smc = package.SMC(fk=model, N=n, resampling="systematic", ESSrmin=1.0, collect="off")

    def step(y: float) -> float:
        observed["y"] = y
        next(smc)
        return float(smc.W @ smc.X)

    return step


def filterpy(n: int) -> Step:
    from filterpy.monte_carlo import systematic_resample

    rng = np.random.default_rng(1)
    state = {"x": rng.normal(size=n), "weights": np.full(n, 1.0 / n)}

    def step(y: float) -> float:
        x = state["x"][systematic_resample(state["weights"])] + WALK * rng.standard_normal(n)
        log_weights = log_likelihood(x, y)
        weights = np.exp(log_weights - log_weights.max())
        weights /= weights.sum()
        state.update(x=x, weights=weights)
        return float(weights @ x)

    return step


def pfilter(n: int) -> Step:
    from pfilter import ParticleFilter, systematic_resample

    rng = np.random.default_rng(1)
    tracker = ParticleFilter(
        prior_fn=lambda count: rng.normal(size=(count, 1)),
        noise_fn=lambda x: x + WALK * rng.standard_normal(x.shape),
        weight_fn=lambda hypotheses, y, **_: np.exp(log_likelihood(hypotheses[:, 0], np.ravel(y)[0])),
        resample_fn=systematic_resample,
        n_particles=n,
    )

    def step(y: float) -> float:
        tracker.update(np.array([y]))
        return float(tracker.mean_state[0])

    return step


def stonesoup(n: int) -> Step:
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.models.transition.linear import RandomWalk
    from stonesoup.predictor.particle import ParticlePredictor
    from stonesoup.resampler.particle import SystematicResampler
    from stonesoup.types.array import StateVectors
    from stonesoup.types.detection import Detection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.state import ParticleState
    from stonesoup.updater.particle import ParticleUpdater

    start = datetime(2000, 1, 1)
    measurement = LinearGaussian(ndim_state=1, mapping=(0,), noise_covar=np.array([[NOISE**2]]))
    predictor = ParticlePredictor(RandomWalk(noise_diff_coeff=WALK**2))
    updater = ParticleUpdater(measurement, SystematicResampler())
    cloud = np.random.default_rng(1).normal(size=(1, n))
    state = {"prior": ParticleState(StateVectors(cloud), weight=np.full(n, 1.0 / n), timestamp=start), "t": 0}

    def step(y: float) -> float:
        state["t"] += 1
        now = start + timedelta(seconds=state["t"])
        prediction = predictor.predict(state["prior"], timestamp=now)
        detection = Detection(np.array([[y]]), timestamp=now, measurement_model=measurement)
        state["prior"] = updater.update(SingleHypothesis(prediction, detection))
        return float(state["prior"].mean[0, 0])

    return step


def cuthbert(n: int) -> Step:
    import jax
    from cuthbert.smc.particle_filter import build_filter
    from cuthbertlib.resampling.systematic import resampling

    smc = build_filter(
        init_sample=jax.random.normal,
        propagate_sample=lambda key, x, _: x + WALK * jax.random.normal(key),
        log_potential=lambda _, x, y: log_likelihood(x, y),
        n_filter_particles=n,
        resampling_fn=resampling,
    )

    @jax.jit
    def update(state, y, key):
        state = smc.filter_combine(state, smc.filter_prepare(y, key=key))
        return state, jax.nn.softmax(state.log_weights) @ state.particles

    key = jax.random.key(1)
    filter_state = {"state": smc.init_prepare(key=key)._replace(model_inputs=jax.numpy.asarray(0.0)), "t": 0}

    def step(y: float) -> float:
        filter_state["t"] += 1
        state, mean = update(filter_state["state"], y, jax.random.fold_in(key, filter_state["t"]))
        filter_state["state"] = state
        return float(mean)

    return step


PEERS = {
    "particles": particles,
    "cuthbert": cuthbert,
    "filterpy": filterpy,
    "pfilter": pfilter,
    "stonesoup": stonesoup,
}
OURS = {
    "pfviz kernels": pfviz_kernels,
    "pfviz Condensation, recorded": pfviz_condensation,
    "plain NumPy": plain_numpy,
}


def kalman_means(observations: np.ndarray) -> np.ndarray:
    mean, variance, means = 0.0, 1.0, []
    for y in observations:
        variance += WALK**2
        gain = variance / (variance + NOISE**2)
        mean, variance = mean + gain * (y - mean), (1.0 - gain) * variance
        means.append(mean)
    return np.array(means)


def follows_the_kalman_filter(make: Callable[[int], Step]) -> bool:
    rng = np.random.default_rng(3)
    observations = np.cumsum(WALK * rng.standard_normal(12)) + NOISE * rng.standard_normal(12)
    step = make(20_000)
    means = np.array([step(float(y)) for y in observations])
    return bool(np.abs(means - kalman_means(observations))[2:].max() < 0.06)


def contestants() -> dict[str, Callable[[int], Step]]:
    chosen = dict(OURS)
    for name, make in PEERS.items():
        try:
            importlib.import_module(name)
        except ImportError as error:
            print(f"- {name} does not import ({error}): left out")
        else:
            chosen[name] = make
    return chosen


def versions(names: list[str]) -> str:
    from importlib.metadata import version

    return ", ".join(f"{name} {version(name)}" for name in names if name in PEERS)


def main() -> None:
    kernels.warm_up()
    print(machine())
    chosen = contestants()
    print(versions(list(chosen)) or "no other package to compare with")
    for name, make in list(chosen.items()):
        if not follows_the_kalman_filter(make):
            print(f"- {name} does not follow the Kalman filter: left out")
            del chosen[name]
    rng = np.random.default_rng(5)
    medians = {}
    for n in SIZES:
        steps = {name: make(n) for name, make in chosen.items()}
        medians[n] = interleaved(steps, [(float(y),) for y in rng.normal(size=50)], rounds=200, seconds=25.0)
    rows = [[name, *(milliseconds(medians[n][name]) for n in SIZES)] for name in chosen]
    if peers := [name for name in chosen if name in PEERS]:
        lead = (min(medians[n][name] for name in peers) / medians[n]["pfviz kernels"] for n in SIZES)
        rows.append(["pfviz kernels, ahead of the fastest other package", *(f"{ratio:.1f}x" for ratio in lead)])
    print_table("A bootstrap step: median time", ["", *(f"N = {n:,}" for n in SIZES)], rows)


if __name__ == "__main__":
    main()
