"""What the left dock says: what to look for, and what the colours mean."""

from __future__ import annotations

from pfviz.filters import FILTERS
from pfviz_app.scenarios import SCENARIOS
from pfviz_app.stage.palette import DARK, LIGHT, Rgb

_LOOK_FOR = {
    "condensation": (
        "Innovations come **from the dynamics**, each from its own history. Nothing is drawn from the image: when the "
        "target leaves the cloud, nobody looks elsewhere."
    ),
    "basic-sir": (
        "Innovation *i* is joined to history *i*, **whatever they are**. Grey arrows are next to impossible. Below: "
        "a few pairs that happen to fit take all the weight."
    ),
    "rb-hs-sir": (
        "Every innovation **chooses a history** that could have produced it (orange) among all (grey). Below: many "
        "particles share the weight."
    ),
}
_LOOK_FOR["rb-ss-hs-sir"] = (
    _LOOK_FOR["rb-hs-sir"] + " On the video the detector proposes x and y only; the rest follows from the history."
)
_LOOK_FOR |= {
    "hs-sir": (
        "Innovations are **drawn by their worth**, then each draws a history. All new particles weigh the same: look "
        "for several copies of one innovation with different histories."
    ),
    "innovation-sir": (
        "The other way about: **each history chooses an innovation** that it could have produced. Many may choose the "
        "same one."
    ),
    "icondensation": (
        "Some particles are predicted, some proposed, some start anew. The proposed ones join **any** history but are "
        "weighed as if it had been sampled: joins that cannot be keep their weight. **Biased.**"
    ),
    "auxiliary": (
        "Histories are weighed by **what they would see**, before anything is drawn. Good histories multiply, the "
        "second weights are nearly even."
    ),
    "unscented": (
        "Every particle asks **a Kalman filter of its own** where to go, given the observation. Nothing is wasted "
        "where the answer is a Gaussian."
    ),
    "ls-n-ips": (
        "Predicted particles **climb the likelihood** before they are weighed. Better placed, but no longer drawn from "
        "what the weights assume: **biased.**"
    ),
    "ls-hs-sir": (
        "Scouts climb the likelihood; innovations are drawn where they end; histories are sampled. The search is paid "
        "for in likelihoods, not in bias."
    ),
}
_PREDICT = {
    "condensation": "make the system noise four times too small. What happens?",
    "basic-sir": "halve the system noise. Does the ESS rise or fall?",
    "hs-sir": "can one innovation fill the whole new set?",
    "rb-hs-sir": "make the proposal four times too wide. Who pays, ESS or error?",
    "rb-ss-hs-sir": "make the proposal four times too wide. Who pays, ESS or error?",
    "innovation-sir": "make the proposal very narrow. What do all histories choose?",
    "icondensation": "watch the green and the black curve. Do they agree?",
    "auxiliary": "make the system noise four times larger. Does looking ahead still help?",
    "unscented": "make the observation noise tiny. Does the ESS fall?",
    "ls-n-ips": "is the green curve too narrow or too wide?",
    "ls-hs-sir": "make the proposal very wide. Does it matter at all?",
}


def explanation(filter_name: str, situation: str | None = None) -> str:
    """Markdown on what to look for with this filter, or in a situation of the gallery."""
    if situation is not None:
        scenario = SCENARIOS[situation]
        return f"#### {scenario.title}\n\n{scenario.look_for}\n"
    info = FILTERS[filter_name]
    look = _LOOK_FOR.get(filter_name, info.summary.capitalize() + ".")
    predict = f"**Predict:** {_PREDICT[filter_name]}" if filter_name in _PREDICT else ""
    return f"#### {info.title}\n\n{look}\n\n{predict}\n"


def legend(dark: bool) -> str:
    """HTML on what the colours mean."""
    palette = DARK if dark else LIGHT
    rows: tuple[tuple[Rgb, str], ...] = (
        (palette.history, "histories: the particles before the step"),
        (palette.proposal, "innovations and the density they are drawn from"),
        (palette.likelihood, "the observation and its likelihood"),
        (palette.posterior, "new particles and the estimate"),
        (palette.exact, "exact posterior"),
        (palette.truth, "truth"),
        (palette.chosen, "what you clicked: see its receipt"),
        (palette.rival, "the filter that it is compared with"),
        ((20, 20, 24), "on the video: outlines of likely particles"),
        ((240, 240, 240), "on the video: the expected outline"),
    )
    dot = "width:12px;height:12px;border-radius:7px;flex:none;border:1px solid #8888"
    items = "".join(
        '<div style="display:flex;align-items:center;gap:8px;margin:3px 0">'
        f'<span style="{dot};background:rgb{colour}"></span>{text}</div>'
        for colour, text in rows
    )
    note = '<div style="margin-top:6px;opacity:.75">The stronger a dot or a line, the larger its weight.</div>'
    return f'<div style="font-size:12.5px;line-height:1.35;padding:0 12px 10px">{items}{note}</div>'
