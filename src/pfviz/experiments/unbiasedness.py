"""Whose evidence is unbiased, how much history sampling takes from its variance, and what ICondensation's bias is.

The sources prove that the new algorithms are unbiased and argue that Rao-Blackwellising reduces the variance
(section 2), and that ICondensation is biased: less so where all particles lie together or where the prediction is
flat (section 4). All of it can be measured where Kalman's answer is exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pfviz.experiments.cells import by_run, difference, grouped, mean, plain_arms, run_cells
from pfviz.experiments.experiment import Experiment, Job, Row, blocks
from pfviz.experiments.statistics import Estimate, mean_of, paired_difference, sign_of
from pfviz.experiments.summary import Cell, Curve, CurveFigure, CurvePanel, Summary, Table
from pfviz.filters import FILTERS

WORLD = "linear-gaussian"
_PARTICLES, _STEPS = 100, 20
_COUNTS = (25, 400)
_PLAIN_AND_HISTORY = ("condensation", "basic-sir", "hs-sir", "rb-hs-sir")
_BIAS_FILTERS, _BIAS_PARTICLES, _BIAS_STEPS, _BIAS_SHARE = ("icondensation", "rb-hs-sir"), 1000, 40, 20
_SYSTEM, _PROPOSAL = (0.25, 1.0, 4.0), (0.5, 1.0, 2.0, 4.0)
_SURE = 2.8
"""Standard errors: of ten filters that all agree, one lies beyond in one of twenty reports."""


def jobs(seeds: int) -> list[Job]:
    """Evidence ratios of all filters; of four of them with other numbers of particles; the grid of the bias."""
    names = [name for name in FILTERS if name != "rb-ss-hs-sir"]
    ratios = [arm.at(WORLD, steps=_STEPS) for arm in plain_arms(names, _PARTICLES)]
    ratios += [arm.at(WORLD, steps=_STEPS) for n in _COUNTS for arm in plain_arms(_PLAIN_AND_HISTORY, n)]
    grid = [
        arm.at(WORLD, steps=_BIAS_STEPS, matched=True, system=system, proposal=proposal)
        for system in _SYSTEM
        for proposal in _PROPOSAL
        for arm in plain_arms(_BIAS_FILTERS, _BIAS_PARTICLES)
    ]
    return blocks(ratios, seeds, 50) + blocks(grid, max(2, seeds // _BIAS_SHARE), 5)


def ratio(rows: Sequence[Row]) -> Estimate:
    """The mean of the estimated evidence over the exact one; 1 without bias. Zero where the estimate was zero."""
    return mean_of([0.0 if value is None else float(np.exp(value)) for value in _log_ratios(rows)])


def _log_ratios(rows: Sequence[Row]) -> list[float | None]:
    return [row["log_evidence_ratio"] for row in rows]


def deviation(rows: Sequence[Row]) -> float:
    """The standard deviation of the logarithm of that ratio."""
    present = [value for value in _log_ratios(rows) if value is not None]
    return float(np.std(present, ddof=1)) if len(present) > 1 else float("nan")


def z_score(estimate: Estimate) -> float:
    """How many standard errors a mean ratio is from 1."""
    half = 0.5 * (estimate.high - estimate.low) / 1.96
    return (estimate.value - 1.0) / half if 0.0 < half < np.inf else float("nan")


def summarise(rows: Sequence[Row]) -> Summary:
    """The ratios, the spread of their logarithms against N, and the bias over its grid."""
    evidence = [row for row in rows if "matched" not in row]
    grid = [row for row in rows if "matched" in row]
    ratios = _ratio_table([row for row in evidence if row["particles"] == _PARTICLES])
    spreads, bias = _spread_table(evidence), _bias_table(grid)
    figures = [*_spread_figure(spreads), *_bias_figure(bias)]
    sentences = [*_ratio_sentences(ratios), *_spread_sentences(evidence), *_bias_sentences(bias)]
    return Summary((ratios, spreads, bias), figures, sentences)


def _ratio_table(rows: Sequence[Row]) -> Table:
    cells: list[tuple[Cell, ...]] = []
    for (name,), members in grouped(rows, "filter").items():
        estimate, info = ratio(members), FILTERS[name]
        said = "unbiased" if info.unbiased else "biased"
        line = (info.title, said, len(members), estimate.value, estimate.low, estimate.high, z_score(estimate))
        cells.append((*line, deviation(members)))
    columns = ("filter", "said to be", "runs", "evidence over exact", "low", "high", "standard errors from 1")
    title = f"Evidence of {_STEPS} steps over the exact one, {_PARTICLES} particles"
    return Table("evidence-ratios", title, (*columns, "deviation of its logarithm"), tuple(cells))


def _ratio_sentences(table: Table) -> list[str]:
    sentences = []
    for title, said, runs, value, low, high, z, _ in table.rows:
        if not isinstance(z, float) or not np.isfinite(z):
            continue
        agrees = abs(z) < _SURE
        words = "agrees with 1" if agrees else "differs from 1"
        expected = "" if agrees == (said == "unbiased") else f", though it is said to be {said}"
        sentences.append(
            f"{title}: evidence over exact {value:.3g} [{low:.3g}, {high:.3g}] in {runs} runs {words}{expected} "
            f"({z:+.1f} standard errors)."
        )
    return sentences


def _spread_table(rows: Sequence[Row]) -> Table:
    chosen = [row for row in rows if row["filter"] in _PLAIN_AND_HISTORY]
    cells = [
        (FILTERS[name].title, count, len(members), deviation(members), mean(members, "excess").value)
        for (name, count), members in sorted(grouped(chosen, "filter", "particles").items())
    ]
    columns = ("filter", "particles", "runs", "deviation of log evidence", "error against exact (deviations)")
    return Table("evidence-spread", "Rao-Blackwellised history sampling against plain", columns, tuple(cells))


def _spread_figure(table: Table) -> list[CurveFigure]:
    curves = []
    for title in dict.fromkeys(table.column("filter")):
        points = [(row[1], row[3]) for row in table.rows if row[0] == title]
        x, y = np.array(points, dtype=float).T
        curves.append(Curve(str(title), x, y))
    labels = ("Spread of the estimated evidence", "particles", "standard deviation of its logarithm")
    return [CurveFigure("evidence-spread", *labels, (CurvePanel(WORLD, tuple(curves)),), True, True)] if curves else []


def _spread_sentences(rows: Sequence[Row]) -> list[str]:
    """Whether the squared deviations of log evidence of one filter are smaller than those of another, run by run."""
    sentences = []
    for first, second in (("hs-sir", "basic-sir"), ("rb-hs-sir", "hs-sir"), ("rb-hs-sir", "condensation")):
        for count in sorted({row["particles"] for row in rows}):
            both = [[r for r in rows if r["filter"] == name and r["particles"] == count] for name in (first, second)]
            if min(map(len, both)) < 2:
                continue
            gap = paired_difference(squared_deviations(both[0]), squared_deviations(both[1]))
            words = {"less": "smaller than", "greater": "greater than", "undecided": "not to be told from"}[
                sign_of(gap)
            ]
            titles = [FILTERS[name].title for name in (first, second)]
            sentences.append(
                f"With {count} particles the variance of {titles[0]}'s log evidence is {words} that of {titles[1]} "
                f"({deviation(both[0]) ** 2:.3g} and {deviation(both[1]) ** 2:.3g}; difference {gap})."
            )
    return sentences


def squared_deviations(rows: Sequence[Row]) -> dict[Any, float | None]:
    """By run, the squared distance of its log evidence ratio from their mean."""
    by_seed = by_run(rows, "log_evidence_ratio")
    centre = mean_of(by_seed.values()).value
    return {key: None if value is None else (value - centre) ** 2 for key, value in by_seed.items()}


def _bias_table(rows: Sequence[Row]) -> Table:
    cells: list[tuple[Cell, ...]] = []
    for (system, proposal), members in grouped(rows, "system", "proposal").items():
        of = {name: [row for row in members if row["filter"] == name] for name in _BIAS_FILTERS}
        gap = difference(of[_BIAS_FILTERS[0]], of[_BIAS_FILTERS[1]], "excess")
        biased, right = (mean(of[name], "excess") for name in _BIAS_FILTERS)
        evidence = mean(of[_BIAS_FILTERS[0]], "log_evidence_ratio").value
        cells.append((system, proposal, gap.count, biased.value, right.value, gap.value, gap.low, gap.high, evidence))
    columns = ("system noise", "width of proposal", "runs", "ICondensation: error", "RB-HS-SIR: error")
    columns += ("bias", "low", "high", "its log evidence over exact")
    title = f"Error against the exact mean in its deviations, {_BIAS_PARTICLES} particles"
    return Table("icondensation-bias", title, columns, tuple(cells))


def _bias_figure(table: Table) -> list[CurveFigure]:
    curves = []
    for system in dict.fromkeys(table.column("system noise")):
        points = [[row[i] for i in (1, 5, 6, 7)] for row in table.rows if row[0] == system]
        curves.append(Curve(f"system noise × {system:g}", *np.array(points, dtype=float).T))
    labels = ("ICondensation's bias", "width of the proposal, as a factor", "excess error in exact deviations")
    return (
        [CurveFigure("icondensation-bias", *labels, (CurvePanel(WORLD, tuple(curves)),), log_x=True)] if curves else []
    )


def _bias_sentences(table: Table) -> list[str]:
    rows = [row for row in table.rows if isinstance(row[2], int) and row[2] > 1]
    if not rows:
        return []
    sure = [row for row in rows if isinstance(row[6], float) and row[6] > 0.0]
    sentences = [
        f"ICondensation's error exceeds RB-HS-SIR's, which is all sampling error, in {len(sure)} of {len(rows)} "
        f"settings of system noise and proposal with {_BIAS_PARTICLES} particles each."
    ]
    means = {system: mean_of([row[5] for row in rows if row[0] == system]) for system in _SYSTEM}  # type: ignore[misc]
    order = sorted((system for system in _SYSTEM if means[system].count), key=lambda system: means[system].value)
    if len(order) > 1:
        listed = ", ".join(f"{means[system].value:.3g} with noise × {system:g}" for system in order)
        sentences.append(f"The excess, in deviations of the exact posterior, averaged over the proposals: {listed}.")
    return sentences


UNBIASEDNESS = Experiment(
    name="unbiasedness",
    title="Bias and variance of the evidence",
    question="On the linear-Gaussian world, where Kalman is exact: is the mean of the estimated evidence over the "
    "exact one equal to 1? How much of its spread does history sampling take away? How far is ICondensation off?",
    seeds=1000,
    jobs=jobs,
    run=run_cells,
    summarise=summarise,
)
