"""What the left dock says: what to look for, and what the colours mean."""

from __future__ import annotations

from pfviz.filters import FILTERS
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
_PREDICT = {
    "condensation": "make the system noise four times too small. What happens?",
    "basic-sir": "halve the system noise. Does the ESS rise or fall?",
    "rb-hs-sir": "make the proposal four times too wide. Who pays, ESS or error?",
}
_PREDICT["rb-ss-hs-sir"] = _PREDICT["rb-hs-sir"]


def explanation(filter_name: str, world: str) -> str:
    """Markdown on what to look for with this filter in this world."""
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
