"""The filters as the papers print them: one line for every stage, in words and as a formula."""

from __future__ import annotations

import html
from dataclasses import dataclass
from functools import lru_cache

from latex2mathml.converter import convert

from pfviz.record import StageKind
from pfviz_app.stage.palette import DARK, LIGHT


@dataclass(frozen=True, slots=True)
class Line:
    """A line of an algorithm.

    Attributes:
        kind: the stage it belongs to.
        words: what is done.
        formula: in LaTeX.
    """

    kind: StageKind | None
    words: str
    formula: str


_RESAMPLE = Line("resample", "draw ancestors by weight", r"a_i \sim (w^{(1)}, \dots, w^{(N)})")
_PROPOSE = Line("propose", "draw innovations from the detector", r"u^{(i)} \sim \pi(u \mid y)")
_SAMPLE = Line("associate", "each innovation draws a history", r"I_i \sim w^{(\cdot)}\, p(u^{(i)} \mid x^{(\cdot)})")
_COMPLETE = Line("complete", "the rest follows from the history", r"v^{(i)} \sim p(v \mid u^{(i)}, x^{(I_i)})")
_MIXTURE = Line(
    "weight",
    "likelihood × mixture ÷ proposal",
    r"\frac{p(y \mid u^{(i)}, v^{(i)})\, \sum_l w^{(l)} p(u^{(i)} \mid x^{(l)})}{\pi(u^{(i)} \mid y)}",
)
_POSTERIOR = Line(None, "the posterior", r"p(x \mid y_{1:t}) \approx \sum_i w^{(i)} \delta_{x^{(i)}}")

ALGORITHMS: dict[str, tuple[Line, ...]] = {
    "condensation": (
        _RESAMPLE,
        Line("predict", "draw from the dynamics", r"x^{(i)} \sim p(x \mid x^{(a_i)})"),
        Line("weight", "likelihood", r"w^{(i)} \propto p(y \mid x^{(i)})"),
        _POSTERIOR,
    ),
    "basic-sir": (
        _RESAMPLE,
        _PROPOSE,
        Line("associate", "innovation i joins history i", r"I_i = i"),
        _COMPLETE,
        Line(
            "weight",
            "likelihood × transition ÷ proposal",
            r"\frac{p(y \mid u^{(i)})\, p(u^{(i)} \mid x^{(i)})}{\pi(u^{(i)} \mid y)}",
        ),
        _POSTERIOR,
    ),
    "rb-hs-sir": (_PROPOSE, _SAMPLE, _COMPLETE, _MIXTURE, _POSTERIOR),
    "rb-ss-hs-sir": (_PROPOSE, _SAMPLE, _COMPLETE, _MIXTURE, _POSTERIOR),
}


@lru_cache(maxsize=128)
def _mathml(formula: str) -> str:
    return convert(formula).replace('display="inline"', 'displaystyle="true"')


def algorithm(filter_name: str, stage: int | None, dark: bool) -> str:
    """HTML with the lines of the algorithm, the one at ``stage`` marked; None marks the posterior."""
    lines = ALGORITHMS.get(filter_name, ())
    active = len(lines) - 1 if stage is None else min(stage, len(lines) - 1)
    palette = DARK if dark else LIGHT
    rows = []
    for i, line in enumerate(lines):
        on = i == active
        bar = f"rgb{palette.proposal}" if on else "transparent"
        weight, opacity = ("600", "1") if on else ("400", ".62")
        rows.append(
            f'<div style="border-left:3px solid {bar};padding:2px 0 3px 9px;margin:2px 0;opacity:{opacity}">'
            f'<div style="font-weight:{weight}">{html.escape(line.words)}</div>{_mathml(line.formula)}</div>'
        )
    return f'<div style="font-size:12.5px;line-height:1.3;padding:0 10px 8px">{"".join(rows)}</div>'
