"""The filters of the sources on real video with ground truth."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from pfviz.experiments.cells import grouped, mean, plain_mean, run_cells
from pfviz.experiments.experiment import Experiment, Job, Row, blocks
from pfviz.experiments.statistics import wilson
from pfviz.experiments.summary import Cell, Curve, CurveFigure, CurvePanel, Summary, Table
from pfviz.experiments.trackers import clip_names
from pfviz.experiments.tracking import arms, claim_sentences, error_curve, explanations, loss_curve, orderings

_FILTERS = ("condensation", "basic-sir", "rb-ss-hs-sir", "icondensation", "auxiliary")


def jobs(
    seeds: int, filters: Sequence[str] = _FILTERS, share: float = 1.0, clips: Sequence[str] | None = None
) -> list[Job]:
    """All filters on all clips that ``PFVIZ_CLIPS`` has.

    Raises:
        ExperimentError: if there are none.
    """
    chosen = clip_names() if clips is None else clips
    return blocks([arm.at(f"clip:{name}") for name in chosen for arm in arms(filters, share)], seeds, 2)


def summarise(rows: Sequence[Row]) -> Summary:
    """The table of the tracking experiment, clip by clip."""
    cells: list[tuple[Cell, ...]] = []
    for (place, label), members in grouped(rows, "place", "label").items():
        error, end = mean(members, "error"), wilson(sum(row["lost_at_end"] for row in members), len(members))
        line = (place.partition(":")[2], label, members[0]["particles"], len(members))
        numbers = (error.value, error.low, error.high, plain_mean(members, "lost"), end.value, end.low, end.high)
        cells.append((*line, *numbers))
    columns = ("clip", "filter", "particles", "runs", "error (px of 240 x 180)", "low", "high")
    columns += ("share of frames lost", "lost at the end", "end low", "end high")
    table = Table("real-clips", "Real clips against their ground truth", columns, tuple(cells))
    errors, losses = (
        CurveFigure(f"real-clips-{name}", title, "frame", label, _panels(rows, curve))
        for name, title, label, curve in (
            ("error", "Tracking error", "distance, runs not lost", error_curve),
            ("loss", "Probability of losing the object", "share of runs lost", loss_curve),
        )
    )
    claims = {what: orderings(rows, what) for what in ("error", "lost")}
    sentences = [*claim_sentences(claims["error"], "error"), *claim_sentences(claims["lost"], "share of frames lost")]
    return Summary((table, *claims.values(), explanations(rows)), (errors, losses) if rows else (), sentences)


def _panels(rows: Sequence[Row], make: Callable[[str, Sequence[Row]], Curve]) -> tuple[CurvePanel, ...]:
    return tuple(
        CurvePanel(
            place.partition(":")[2],
            tuple(make(label, same) for (label,), same in grouped(members, "label").items()),
        )
        for (place,), members in grouped(rows, "place").items()
    )


REAL_CLIPS = Experiment(
    name="real-clips",
    title="Real clips",
    question="The filters with particle numbers of equal running time on the clips in the folder that PFVIZ_CLIPS "
    "names, each begun with the true box of the first frame that shows the whole object. Distances are in pixels of a "
    "frame of the sources' size, 240 x 180, to which every clip is scaled by its diagonal.",
    seeds=10,
    jobs=jobs,
    run=run_cells,
    summarise=summarise,
)
