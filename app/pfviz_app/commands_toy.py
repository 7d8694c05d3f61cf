"""``pfviz toy``: a filter on a toy world, as JSON Lines that carry all that is needed to check it."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from pfviz.exact import Gaussian, GridDensity, GridStep, KalmanStep
from pfviz.filters import make_filter
from pfviz.running import run
from pfviz.worlds import ToyModel, World, get_world


def toy(options: argparse.Namespace) -> None:
    """Run the command and print its lines."""
    world = get_world(options.world)
    model = world.model.with_noise(options.system, options.observation, options.proposal)
    for seed in range(options.seed, options.seed + options.repeat):
        extra = {"seed": seed} if options.repeat > 1 else {}
        if options.json:
            print(json.dumps(_header(world, model, options, seed)))
        else:
            print(f"# {world.title}: {options.filter}, {options.particles} particles, seed {seed}")
        for line in _lines(world, model, options, seed):
            print(json.dumps(line | extra) if options.json else _readable(line), flush=False)


def _header(world: World, model: ToyModel, options: argparse.Namespace, seed: int) -> dict[str, Any]:
    covariance = model.observation_covariance
    return {
        "pfviz": _version(),
        "world": world.name,
        "filter": options.filter,
        "particles": options.particles,
        "seed": seed,
        "model": {
            "coefficients": model.dynamics.coefficients.tolist(),
            "mean": model.dynamics.mean.tolist(),  # type: ignore[union-attr]
            "noise_covariance": model.dynamics.noise_covariance.tolist(),
            "observation_covariance": None if covariance is None else covariance.tolist(),
            "prior_mean": model.prior.mean.tolist(),
            "prior_covariance": model.prior.covariance.tolist(),
        },
    }


def _version() -> str:
    try:
        return version("pfviz")
    except PackageNotFoundError:
        return "not installed"


def _lines(world: World, model: ToyModel, options: argparse.Namespace, seed: int) -> Iterator[dict[str, Any]]:
    recording = world.record(seed, options.steps)
    filter_ = make_filter(options.filter, options.particles)
    exact = _exact_steps(model, recording.observations)
    records = run(filter_, model, recording.observations, seed)
    for t, (record, truth, step) in enumerate(zip(records, recording.truth, exact, strict=True), start=1):
        marginal = None if step is None else step.posterior.leading(model.dynamics.dimension)
        yield {
            "t": t,
            "truth": truth.tolist(),
            "observation": None if record.condition == "missing" else record.observation.tolist(),
            "mean": record.estimate.tolist(),
            "covariance": record.posterior.covariance.tolist(),
            "exact_mean": None if marginal is None else marginal.mean.tolist(),
            "exact_covariance": None if marginal is None else marginal.covariance.tolist(),
            "ess": record.effective_sample_size,
            "log_evidence": _finite(record.log_evidence),
            "exact_log_evidence": None if step is None else step.log_evidence,
            "condition": record.condition,
        }


def _exact_steps(model: ToyModel, observations: tuple[Any, ...]) -> Iterator[KalmanStep | GridStep | None]:
    state: Gaussian | GridDensity = model.prior
    for observation in observations:
        step = model.exact_step(state, observation)
        if step is not None:
            state = step.posterior
        yield step


def _finite(value: float | None) -> float | None:
    """JSON has no infinity: an evidence of zero is given as null, with the condition "degenerate"."""
    return value if value is not None and math.isfinite(value) else None


def _readable(line: dict[str, Any]) -> str:
    def numbers(values: list[float] | None) -> str:
        return "-" if values is None else " ".join(f"{value:8.3f}" for value in values)

    return (
        f"t {line['t']:4d}  truth {numbers(line['truth'])}  mean {numbers(line['mean'])}  "
        f"exact {numbers(line['exact_mean'])}  ESS {line['ess']:8.1f}"
    )
