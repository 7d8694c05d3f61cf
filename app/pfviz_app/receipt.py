"""One particle's weight as a receipt: the factors that were multiplied, and what they come to."""

from __future__ import annotations

import html
from dataclasses import dataclass

import numpy as np

from pfviz.genealogy import first_of_equals
from pfviz.particles import FloatArray, log_sum_exp
from pfviz.record import StepRecord
from pfviz_app.framing import framed
from pfviz_app.stage.palette import DARK, LIGHT
from pfviz_app.stage.seen import Seen, likeliest_histories

_FACTORS = {
    "likelihood": "likelihood p(y|x)",
    "transition": "transition p(u|x)",
    "mixture": "mixture Σ w p(u|x)",
    "proposal": "÷ proposal π(u|y)",
    "preview": "÷ look ahead p(y|m)",
}
_DIVISORS = ("proposal", "preview")
_MOST_HISTORIES = 4


@dataclass(frozen=True, slots=True)
class Receipt:
    """How one weight came about: ``weight = before * product of factors / normaliser``.

    Attributes:
        index: of the particle among those that were weighed.
        state: ``(k,)``, its innovation.
        before: its weight before the factors.
        factors: names and values.
        normaliser: the sum of all weights before normalising.
        weight: what it comes to.
        rank: 1 for the heaviest.
        count: of particles.
        history: the index of its history among the particles before the step, of the first where there are copies; -1
            for none.
        choices: the most probable histories of its innovation and their probabilities, where histories are sampled.
    """

    index: int
    state: FloatArray
    before: float
    factors: tuple[tuple[str, float], ...]
    normaliser: float
    weight: float
    rank: int
    count: int
    history: int
    choices: tuple[tuple[int, float], ...]


def receipt(record: StepRecord, index: int) -> Receipt | None:
    """The receipt of the particle at ``index`` in the weighed set; None where nothing was weighed."""
    found = [i for i, stage in enumerate(record.stages) if stage.kind == "weight"]
    if not found or not 0 <= index < len(record.stages[found[-1]].particles):
        return None
    stage = record.stages[found[-1]]
    earlier = record.stages[found[-1] - 1].particles if found[-1] else record.previous
    history, choices = _joined(record, index)
    log_weights = stage.particles.log_weights
    log_factors = {name: float(values[index]) for name, values in stage.log_factors.items()}
    log_before = float(earlier.log_weights[index])
    unnormalised = earlier.log_weights + sum(stage.log_factors.values(), np.zeros(len(log_weights)))
    return Receipt(
        index=index,
        state=stage.particles.innovation[index],
        before=float(np.exp(log_before)),
        factors=tuple((name, float(np.exp(value))) for name, value in log_factors.items()),
        normaliser=float(np.exp(log_sum_exp(unnormalised))),
        weight=float(np.exp(log_weights[index])),
        rank=int(np.sum(log_weights > log_weights[index])) + 1,
        count=len(stage.particles),
        history=history,
        choices=choices,
    )


def _joined(record: StepRecord, index: int) -> tuple[int, tuple[tuple[int, float], ...]]:
    """The history that the weighed particle was joined to, -1 for none, and its most probable ones."""
    joins = Seen(record).joins()
    particles = np.flatnonzero(joins[2] == index) if joins else np.empty(0, np.int64)
    if joins is None or not len(particles):
        return -1, ()
    found, probabilities = likeliest_histories(record, int(particles[0]), _MOST_HISTORIES)
    choices = tuple((int(i), float(p)) for i, p in zip(found, probabilities, strict=True))
    history = int(joins[0][particles[0]])
    return (history if history < 0 else int(first_of_equals(record.previous)[history])), choices


def receipt_html(slip: Receipt | None, dark: bool) -> str:
    """The receipt as a table, or how to get one."""
    if slip is None:
        return framed("Click a particle, an innovation or an outline in the picture to see how its weight came about.")
    palette = DARK if dark else LIGHT
    rows = [("weight before", _number(slip.before))]
    rows += [
        (("" if name in _DIVISORS else "× ") + _FACTORS.get(name, name), _factor(name, value))
        for name, value in slip.factors
    ]
    rows += [("÷ sum over all particles", _number(slip.normaliser))]
    body = "".join(_row(label, value) for label, value in rows)
    total = _row("= weight", _number(slip.weight), f"font-weight:600;border-top:1px solid rgb{palette.ink}")
    state = ", ".join(f"{value:.4g}" for value in slip.state)
    head = f"<b>Particle {slip.index}</b> at ({html.escape(state)}), number {slip.rank} of {slip.count} by weight"
    chosen = "no history" if slip.history < 0 else f"history {slip.history}"
    joins = "".join(
        _row(f"history {i}{' (chosen)' if i == slip.history else ''}", f"{probability:.1%}")
        for i, probability in slip.choices
    )
    table = '<table style="width:100%;border-collapse:collapse;margin:6px 0">'
    association = (
        f"<div>joined to {chosen}; the most probable are</div>{table}{joins}</table>"
        if joins
        else f"<div>{chosen}</div>"
    )
    return framed(f"<div>{head}</div>{table}{body}{total}</table>{association}")


def _factor(name: str, value: float) -> str:
    """What divides is shown as the density itself."""
    return _number(1.0 / value) if name in _DIVISORS and value > 0 else _number(value)


def _number(value: float) -> str:
    return f"{value:.5g}"


def _row(label: str, value: str, style: str = "") -> str:
    cell = "padding:1px 0;text-align:right;font-variant-numeric:tabular-nums"
    return f'<tr style="{style}"><td>{html.escape(label)}</td><td style="{cell}">{html.escape(value)}</td></tr>'
