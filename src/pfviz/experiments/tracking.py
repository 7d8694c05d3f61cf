"""The experiment of the sources (section 3): how far from the object each filter is, and how often it loses it.

CONDENSATION(3), (5) and (10) are CONDENSATION with that variance of the system noise: of x and y, in square pixels
of frames of 240 x 180, which is how the second text is read here; it gives no unit. The other filters have 5.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from pfviz.experiments.cells import Arm, difference, grouped, mean, plain_mean, run_cells, time_table
from pfviz.experiments.experiment import Experiment, Job, Row, blocks
from pfviz.experiments.statistics import FEWEST, Estimate, mean_of, rank_correlation, sign_of, wilson
from pfviz.experiments.summary import Cell, Curve, CurveFigure, CurvePanel, Summary, Table
from pfviz.experiments.trackers import LOST
from pfviz.filters import FILTERS
from pfviz.particles import FloatArray

EQUAL_TIME_PARTICLES = {
    "condensation": 2000,
    "basic-sir": 980,
    "hs-sir": 630,
    "rb-ss-hs-sir": 720,
    "innovation-sir": 840,
    "icondensation": 770,
    "auxiliary": 790,
    "unscented": 110,
    "ls-n-ips": 84,
    "ls-hs-sir": 90,
}
"""Particles of equal running time, as `pfviz experiment equal-time` measured them; see docs/results.md."""

PLACES = tuple(
    f"scene:{kind}:{seed}"
    for kind in ("twin", "twin-small", "twin-large", "twin-fast", "twin-near", "twin-patches")
    for seed in (1, 2)
)
_IN_THE_SOURCES = ("CONDENSATION(3)", "CONDENSATION(5)", "CONDENSATION(10)", "Basic-SIR", "RB-SS-HS-SIR")


_EXPLAINING = {
    "ess_share": "the ESS share",
    "proposal_spread": "the spread of the proposed particles",
    "near_share": "the share of them near the object",
    "sharpness": "the sharpness of the likelihood",
}


def arms(names: Sequence[str] = tuple(EQUAL_TIME_PARTICLES), share: float = 1.0) -> tuple[Arm, ...]:
    """The contestants, with a share of the particles of equal running time."""
    contestants = []
    for name in names:
        particles = max(2, round(share * EQUAL_TIME_PARTICLES[name]))
        variances = (3, 5, 10) if name == "condensation" else (5,)
        for variance in variances:
            title = FILTERS[name].title
            label = f"{title}({variance})" if name == "condensation" else title
            contestants.append(Arm(label, name, particles, (("variance", float(variance)),)))
    return tuple(contestants)


def jobs(
    seeds: int, places: Sequence[str] = PLACES, contestants: Sequence[Arm] | None = None, block: int = 4
) -> list[Job]:
    """All contestants at all places."""
    return blocks([arm.at(place) for place in places for arm in contestants or arms()], seeds, block)


@dataclass(frozen=True, slots=True)
class Claim:
    """What a text says of two filters: the first is as good as, or better than, the second."""

    text: str
    first: str
    relation: Literal["≈", "<"]
    second: str


CLAIMS = (
    Claim("both texts", "RB-SS-HS-SIR", "≈", "CONDENSATION(5)"),
    Claim("both texts", "CONDENSATION(5)", "<", "Basic-SIR"),
    Claim("both texts", "RB-SS-HS-SIR", "<", "Basic-SIR"),
    Claim("second text", "CONDENSATION(5)", "<", "CONDENSATION(3)"),
    Claim("second text", "CONDENSATION(3)", "<", "CONDENSATION(10)"),
    Claim("second text", "CONDENSATION(10)", "<", "Basic-SIR"),
)


def verdict(claim: Claim, gap: Estimate) -> str:
    """What the interval of the first minus the second says of a claim."""
    order = sign_of(gap)
    if gap.count < 2:
        return "not measured"
    if claim.relation == "<":
        return {"less": "holds", "greater": "the other way about", "undecided": "not seen"}[order]
    better = {"less": claim.first, "greater": claim.second}
    return "holds as far as can be told" if order == "undecided" else f"does not hold: {better[order]} is better"


def orderings(rows: Sequence[Row], measure: str) -> Table:
    """The claims of the texts against the paired difference of ``measure``."""
    by_label = {label: members for (label,), members in grouped(rows, "label").items()}
    cells: list[tuple[Cell, ...]] = []
    for claim in CLAIMS:
        gap = difference(by_label.get(claim.first, []), by_label.get(claim.second, []), measure)
        words = f"{claim.first} {claim.relation} {claim.second}"
        cells.append((claim.text, words, gap.value, gap.low, gap.high, gap.count, verdict(claim, gap)))
    columns = ("said by", "ordering", "first minus second", "low", "high", "runs", "verdict")
    return Table(f"orderings-{measure}", "The orderings of the texts", columns, tuple(cells))


def explanations(rows: Sequence[Row]) -> Table:
    """What each filter did, in means over all runs, that may explain how well it did."""
    names = ("ess_share", "proposal_spread", "near_share", "sharpness", "posterior_spread")
    cells = []
    for (label, particles), members in grouped(rows, "label", "particles").items():
        means = [plain_mean(members, name) for name in names]
        cells.append((label, particles, None if means[0] is None else means[0] * particles, *means))
    columns = ("filter", "particles", "ESS", "ESS share", "spread of the proposed (px)", "of them within 10 px")
    columns += ("sharpness of the likelihood", "spread of the posterior (px)")
    return Table("explanations", "What may explain it", columns, tuple(cells))


def correlations(rows: Sequence[Row]) -> Table:
    """How the error of a filter (lost frames counting 50 px) goes with what it did, over the scenes."""
    cells: list[tuple[Cell, ...]] = []
    for (label,), members in grouped(rows, "label").items():
        for name, words in _EXPLAINING.items():
            means = [
                (plain_mean(same, "capped"), plain_mean(same, name)) for same in grouped(members, "place").values()
            ]
            pairs = [(error, value) for error, value in means if error is not None and value is not None]
            related = rank_correlation([error for error, _ in pairs], [value for _, value in pairs])
            if np.isfinite(related.value):
                cells.append((label, words, related.value, related.low, related.high, related.count))
    columns = ("filter", "error against", "rank correlation", "low", "high", "scenes")
    return Table("correlations", "What the error goes with, scene by scene", columns, tuple(cells), shown=False)


def correlation_sentences(table: Table) -> list[str]:
    """The correlations that an interval tells from zero, of the sources' filters that propose from the image.

    What CONDENSATION proposes follows from where it is, so there it is the error that explains the rest.
    """
    sentences = []
    for label, words, value, low, high, count in table.rows:
        assert isinstance(value, float) and isinstance(low, float) and isinstance(high, float)
        assert isinstance(count, int)
        if label in _IN_THE_SOURCES[3:] and count >= FEWEST and not low <= 0.0 <= high:
            sentences.append(
                f"Over {count} scenes the error of {label} {'rises' if value > 0 else 'falls'} with {words} "
                f"(rank correlation {value:.2f} [{low:.2f}, {high:.2f}])."
            )
    return sentences


def by_place(rows: Sequence[Row], measure: str, title: str) -> Table:
    """The mean of ``measure`` by kind of scene and filter."""
    labels = [label for (label,) in grouped(rows, "label")]
    cells = []
    for kind, members in by_kind(rows).items():
        means = {label: plain_mean(same, measure) for (label,), same in grouped(members, "label").items()}
        cells.append((kind, *(means.get(label) for label in labels)))
    return Table(f"{measure}-by-scene", title, ("scene", *labels), tuple(cells))


def by_kind(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Rows by the kind of their scene, whatever its seed."""
    kinds: dict[str, list[Row]] = {}
    for row in rows:
        kinds.setdefault(row["place"].split(":")[1], []).append(row)
    return kinds


def distance_matrix(rows: Sequence[Row]) -> FloatArray:
    """``(runs, T)``: the distances by frame; NaN past the end of a run and where the truth is not known."""
    longest = max(len(row["distances"]) for row in rows)
    matrix = np.full((len(rows), longest), np.nan)
    for line, row in zip(matrix, rows, strict=True):
        line[: len(row["distances"])] = [np.nan if value is None else value for value in row["distances"]]
    return matrix


def without_interval(curve: Curve) -> Curve:
    """The line alone, where there are too many to shade."""
    return replace(curve, low=None, high=None)


CurveMaker = Callable[[str, Sequence[Row]], Curve]


def error_curve(label: str, rows: Sequence[Row]) -> Curve:
    """The mean distance by frame over the runs that are not lost in it (Figure 4 of the first text)."""
    away = distance_matrix(rows)
    means = [mean_of(column[column <= LOST]) for column in away.T]
    low, high = np.array([e.low for e in means]), np.array([e.high for e in means])
    low[~np.isfinite(low)], high[~np.isfinite(high)] = np.nan, np.nan
    return Curve(label, np.arange(away.shape[1], dtype=float), np.array([e.value for e in means]), low, high)


def loss_curve(label: str, rows: Sequence[Row]) -> Curve:
    """The share of runs that are lost by frame, with Wilson's interval (Figure 5 of the first text)."""
    away = distance_matrix(rows)
    shares = [wilson(int((column > LOST).sum()), int(np.isfinite(column).sum())) for column in away.T]
    y, low, high = (np.array([getattr(share, name) for share in shares]) for name in ("value", "low", "high"))
    return Curve(label, np.arange(away.shape[1], dtype=float), y, low, high)


def curves_of(rows: Sequence[Row], make: CurveMaker, name: str, title: str, y_label: str) -> tuple[CurveFigure, ...]:
    """The filters of the sources, all scenes together and by kind; then the other filters."""
    shown = [row for row in rows if row["label"] in _IN_THE_SOURCES]
    others = [row for row in rows if row["label"] not in _IN_THE_SOURCES[:4]]
    figures = []
    for suffix, what, chosen in (("", "", shown), ("-other-filters", ": other filters", others)):
        if chosen:
            together = {"all scenes": chosen, **(by_kind(chosen) if not suffix else {})}
            panels = [
                CurvePanel(kind, tuple(make(label, same) for (label,), same in grouped(members, "label").items()))
                for kind, members in together.items()
            ]
            panels[1:] = [CurvePanel(panel.title, tuple(map(without_interval, panel.curves))) for panel in panels[1:]]
            figures.append(CurveFigure(name + suffix, title + what, "frame", y_label, tuple(panels)))
    return tuple(figures)


def curve_table(figure: CurveFigure) -> Table:
    """The numbers of the first panel, frame by frame."""
    curves = figure.panels[0].curves
    columns = ["frame"]
    arrays = [curves[0].x]
    for curve in curves:
        columns += [curve.label, f"{curve.label} low", f"{curve.label} high"]
        arrays += [
            curve.y,
            curve.low if curve.low is not None else curve.y,
            curve.high if curve.high is not None else curve.y,
        ]
    cells = [tuple(float(v) if np.isfinite(v) else None for v in line) for line in np.array(arrays).T]
    return Table(f"{figure.name}-by-frame", figure.title, tuple(columns), tuple(cells), shown=False)


def summarise_error(rows: Sequence[Row]) -> Summary:
    """Figure 4 of the first text (3 of the second) and the ordering that it is said to show."""
    cells = []
    for (label, particles), members in grouped(rows, "label", "particles").items():
        error, capped = mean(members, "error"), mean(members, "capped")
        cells.append((label, particles, len(members), error.value, error.low, error.high, capped.value))
    columns = ("filter", "particles", "runs", "error (px)", "low", "high", "error, lost counting 50 px")
    table = Table("tracking-error", "Distance from the object while it is not lost", columns, tuple(cells))
    figures = curves_of(rows, error_curve, "tracking-error", "Tracking error", "distance (px), runs not lost")
    claims, why = orderings(rows, "error"), explanations(rows)
    tables = [
        table,
        claims,
        why,
        by_place(rows, "error", "Error (px) by scene"),
        related := correlations(rows),
        time_table(rows, "label", "particles"),
    ]
    tables += map(curve_table, figures[:1])
    said = [*claim_sentences(claims, "tracking error"), *why_sentences(rows), *correlation_sentences(related)]
    return Summary(tables, figures, [_runs(rows), *said])


def summarise_loss(rows: Sequence[Row]) -> Summary:
    """Figure 5 of the first text (4 of the second) and the ordering that it is said to show."""
    columns = ("filter", "particles", "runs", "lost at some time", "low", "high")
    columns += ("lost at the end", "end low", "end high", "share of frames lost", "of them on the twin")
    cells = [
        (label, particles, len(members), *_losses(members), plain_mean(members, "lost"), plain_mean(members, "twin"))
        for (label, particles), members in grouped(rows, "label", "particles").items()
    ]
    table = Table("loss-probability", "How often the object is lost (more than 50 px away)", columns, tuple(cells))
    figures = curves_of(rows, loss_curve, "loss-probability", "Probability of losing the object", "share of runs lost")
    claims = orderings(rows, "lost")
    tables = [table, claims, explanations(rows), by_place(rows, "lost", "Share of frames lost, by scene")]
    sentences = [
        _runs(rows),
        *claim_sentences(claims, "share of frames lost"),
        *_twin_sentence(rows),
        *why_sentences(rows),
    ]
    return Summary([*tables, *map(curve_table, figures[:1])], figures, sentences)


def _losses(rows: Sequence[Row]) -> tuple[float, ...]:
    """The shares of runs that are lost at some time and at the end, with their intervals."""
    ever = wilson(sum(row["lost"] > 0 for row in rows), len(rows))
    end = wilson(sum(row["lost_at_end"] for row in rows), len(rows))
    return (ever.value, ever.low, ever.high, end.value, end.low, end.high)


def _runs(rows: Sequence[Row]) -> str:
    places, seeds = {row["place"] for row in rows}, {row["seed"] for row in rows}
    return (
        f"{len(rows)} runs: {len(places)} scenes, {len(seeds)} seeds of every filter on each. "
        "Differences are paired by scene and seed; the intervals are over these scenes, not over all that there may be."
    )


def claim_sentences(claims: Table, what: str) -> list[str]:
    """Every ordering with its verdict and the difference behind it."""
    return [
        f"{str(text).capitalize()}, {what}: {ordering} {judged} (first minus second {gap:.3g} [{low:.3g}, {high:.3g}])."
        for text, ordering, gap, low, high, _, judged in claims.rows
        if judged != "not measured"
    ]


def _twin_sentence(rows: Sequence[Row]) -> list[str]:
    on_twin = mean([row for row in rows if row["lost"] > 0], "twin")
    if on_twin.count < 2:
        return []
    return [f"In runs that lose the object, {on_twin} of the lost frames are spent on its twin ({on_twin.count} runs)."]


def why_sentences(rows: Sequence[Row]) -> list[str]:
    """What the sources' three filters proposed, and what their weights left of it."""
    sentences = []
    for label in ("CONDENSATION(5)", "Basic-SIR", "RB-SS-HS-SIR"):
        members = [row for row in rows if row["label"] == label]
        share, near, spread = (mean(members, name) for name in ("ess_share", "near_share", "proposal_spread"))
        if share.count:
            effective = share.value * members[0]["particles"]
            sentences.append(
                f"{label}: {near.value:.0%} of what it proposes is within 10 px of the object (spread "
                f"{spread.value:.3g} px), and the weights leave an ESS of {effective:.3g} of {members[0]['particles']} "
                f"particles ({share.value:.2%})."
            )
    return sentences + association_sentence(rows)


def association_sentence(rows: Sequence[Row]) -> list[str]:
    """What sampling the histories does to the ESS, and whether they lie so close that it matters little.

    Arbitrary associations cost much where the histories lie further apart than the system noise reaches.
    """
    plain, sampled = ([row for row in rows if row["label"] == label] for label in ("Basic-SIR", "RB-SS-HS-SIR"))
    gap = difference(sampled, plain, "ess_share")
    if gap.count < FEWEST:
        return []
    apart, reach = mean(plain, "posterior_spread").value, float(np.sqrt(2.0 * (plain[0].get("variance") or np.nan)))
    verdict = {"greater": "is greater than", "less": "is smaller than", "undecided": "cannot be told from"}[
        sign_of(gap)
    ]
    reason = "little" if apart < reach else "much"
    return [
        f"RB-SS-HS-SIR's ESS share {verdict} Basic-SIR's (difference "
        f"{gap}). Basic-SIR's histories lie {apart:.3g} px apart (root mean square) and the system noise reaches "
        f"{reach:.3g} px: an arbitrary association costs {reason}."
    ]


_QUESTION = (
    "CONDENSATION with three system noises, Basic-SIR and RB-SS-HS-SIR, and the other filters, with particle numbers "
    "of equal running time, on scenes with a twin of the object"
)
TRACKING_ERROR = Experiment(
    name="tracking-error",
    title="Tracking error",
    question=f"{_QUESTION}: how far from the object are they while they have not lost it?",
    seeds=16,
    jobs=jobs,
    run=run_cells,
    summarise=summarise_error,
    rows_of="tracking",
)
LOSS_PROBABILITY = Experiment(
    name="loss-probability",
    title="Probability of losing the object",
    question=f"{_QUESTION}: how often do they lose it?",
    seeds=16,
    jobs=jobs,
    run=run_cells,
    summarise=summarise_loss,
    rows_of="tracking",
)
