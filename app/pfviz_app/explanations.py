"""What the left dock says: what to look for, and what the colours mean."""

from __future__ import annotations

from pfviz.filters import FILTERS
from pfviz.worlds import WORLDS
from pfviz_app.stage.palette import DARK, LIGHT, Rgb

_LOOK_FOR = {
    "condensation": (
        "The proposals are drawn **from the dynamics**: each innovation has the history it came from. "
        "Nothing drawn from the image helps: when the target leaves the cloud, nobody looks elsewhere."
    ),
    "basic-sir": (
        "Innovation *i* is joined to history *i*, **whatever they are**. A pale arrow is a join that the dynamics "
        "make next to impossible. Look below: almost all the weight falls on the few pairs that happen to fit."
    ),
    "rb-hs-sir": (
        "Every innovation **chooses a history** that could have produced it (orange), among all that could (grey). "
        "Look below: the weight is shared by many particles."
    ),
}
_LOOK_FOR["rb-ss-hs-sir"] = (
    _LOOK_FOR["rb-hs-sir"] + " On the video the detector proposes x and y only; "
    "rotation and scale follow from the chosen history."
)
_PREDICT = {
    "condensation": "**Predict:** what happens when you make the system noise four times too small?",
    "basic-sir": "**Predict:** halve the system noise. Does the ESS rise or fall? Then switch the filter.",
    "rb-hs-sir": "**Predict:** make the proposal four times too wide. Who pays, the ESS or the error?",
    "rb-ss-hs-sir": "**Predict:** make the proposal four times too wide. Who pays, the ESS or the error?",
}


def explanation(filter_name: str, world: str) -> str:
    """Markdown on what to look for with this filter in this world."""
    info = FILTERS[filter_name]
    look = _LOOK_FOR.get(filter_name, info.summary.capitalize() + ".")
    predict = _PREDICT.get(filter_name, "")
    return f"#### {info.title}\n\n{look}\n\n{WORLDS[world].look_for}\n\n{predict}\n"


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
