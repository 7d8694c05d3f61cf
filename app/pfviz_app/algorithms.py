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

_PREDICT = Line("predict", "draw from the dynamics", r"x^{(i)} \sim p(x \mid x^{(a_i)})")
_LIKELIHOOD = Line("weight", "likelihood", r"w^{(i)} \propto p(y \mid x^{(i)})")
_HISTORY_SAMPLING = (_PROPOSE, _SAMPLE, _COMPLETE, _MIXTURE, _POSTERIOR)

ALGORITHMS: dict[str, tuple[Line, ...]] = {
    "condensation": (_RESAMPLE, _PREDICT, _LIKELIHOOD, _POSTERIOR),
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
    "hs-sir": (
        _PROPOSE,
        Line(
            "weight",
            "what each innovation is worth",
            r"\alpha_j = \frac{p(y \mid u^{(j)})}{\pi(u^{(j)} \mid y)} \sum_k w^{(k)} p(u^{(j)} \mid x^{(k)})",
        ),
        Line("resample", "draw innovations by their worth", r"J_i \sim (\alpha_1, \dots, \alpha_N)"),
        Line("associate", "each draws a history", r"I_i \sim w^{(\cdot)}\, p(u^{(J_i)} \mid x^{(\cdot)})"),
        Line("complete", "join them", r"x^{(i)} = (u^{(J_i)}, f_2(x^{(I_i)}))"),
        _POSTERIOR,
    ),
    "rb-hs-sir": _HISTORY_SAMPLING,
    "rb-ss-hs-sir": _HISTORY_SAMPLING,
    "innovation-sir": (
        _RESAMPLE,
        _PROPOSE,
        Line(
            "associate",
            "each history draws an innovation",
            r"J_i \sim \frac{p(y \mid u^{(\cdot)})\, p(u^{(\cdot)} \mid x^{(i)})}{\pi(u^{(\cdot)} \mid y)}",
        ),
        Line("complete", "join them", r"x^{(i)} = (u^{(J_i)}, f_2(x^{(i)}))"),
        Line(
            "weight",
            "the mean over the pool",
            r"\frac{w^{(i)}}{N} \sum_j \frac{p(y \mid u^{(j)})\, p(u^{(j)} \mid x^{(i)})}{\pi(u^{(j)} \mid y)}",
        ),
        _POSTERIOR,
    ),
    "icondensation": (
        _RESAMPLE,
        Line(
            "propose", "predict, propose, or start anew", r"u^{(i)} \sim p(u \mid x^{(a_i)}) \text{ or } \pi(u \mid y)"
        ),
        Line("associate", "innovation i joins history i", r"I_i = i"),
        _COMPLETE,
        Line(
            "weight",
            "the mixture weight, though no history was sampled: biased",
            r"\frac{p(y \mid u^{(i)}, v^{(i)})\, \sum_l w^{(l)} p(u^{(i)} \mid x^{(l)})}{\pi(u^{(i)} \mid y)}",
        ),
        _POSTERIOR,
    ),
    "auxiliary": (
        Line("weight", "look ahead from each history", r"\lambda_k \propto w^{(k)} p(y \mid m_k)"),
        Line("resample", "draw ancestors by that", r"a_i \sim (\lambda_1, \dots, \lambda_N)"),
        _PREDICT,
        Line("weight", "take the look ahead back", r"w^{(i)} \propto \frac{p(y \mid x^{(i)})}{p(y \mid m_{a_i})}"),
        _POSTERIOR,
    ),
    "unscented": (
        _RESAMPLE,
        Line(
            "predict",
            "draw from the particle's own Kalman filter",
            r"x^{(i)} \sim q_i(x) \approx p(x \mid x^{(a_i)}, y)",
        ),
        Line(
            "weight",
            "likelihood × transition ÷ proposal",
            r"\frac{p(y \mid x^{(i)})\, p(x^{(i)} \mid x^{(a_i)})}{q_i(x^{(i)})}",
        ),
        _POSTERIOR,
    ),
    "ls-n-ips": (
        _RESAMPLE,
        _PREDICT,
        Line("search", "climb the likelihood nearby: biased", r"x^{(i)} \leftarrow S_\lambda(x^{(i)}; y)"),
        _LIKELIHOOD,
        _POSTERIOR,
    ),
    "ls-hs-sir": (
        Line("propose", "draw where scouts have climbed to", r"u^{(i)} \sim q(u \mid y)"),
        *_HISTORY_SAMPLING[1:],
    ),
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
