"""Everything a visitor can set: one frozen record, and one table with each control's range and text."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any, Literal

from pfviz.filters import FILTERS
from pfviz.worlds import WORLDS

Pane = Literal["both", "toy", "tracker"]
Overlay = Literal["none", "proposal", "edges"]
NOBODY, ITSELF = "none", "itself"
"""What a filter is compared with, where it is not another filter: nothing, or what it was itself when it was kept."""
RUNNING = ("filter", "toy_particles", "tracker_particles", "system", "observation", "proposal")
"""The settings that change how a step is run; they may change from step to step."""
Choices = tuple[tuple[str, str], ...]


class SettingError(ValueError):
    """A wish that cannot be granted: the message names the control, the value and what was expected."""


@dataclass(frozen=True, slots=True)
class Settings:
    """What a visitor has set. Noises are factors on standard deviations, as the filters believe them."""

    world: str = "figure-1"
    filter: str = "rb-ss-hs-sir"
    toy_particles: int = 24
    tracker_particles: int = 400
    system: float = 1.0
    observation: float = 1.0
    proposal: float = 1.0
    seed: int = 0
    speed: float = 4.0
    pane: Pane = "both"
    arrows: int = 160
    rival: str = NOBODY
    overlay: Overlay = "none"
    ancestry: bool = False
    truth: bool = True
    exact: bool = True
    dark: bool = False

    @property
    def noises(self) -> dict[str, float]:
        """The factors by name, as ``model`` of a film and ``with_noise`` of a model take them."""
        return {"system": self.system, "observation": self.observation, "proposal": self.proposal}

    def with_value(self, field: str, value: Any) -> Settings:
        """The settings with one of them changed.

        Raises:
            SettingError: naming the control, the value and what was expected.
        """
        if field not in {f.name for f in fields(self)}:
            raise SettingError(f"unknown setting {field!r}")
        control = CONTROLS.get(field)
        return replace(self, **{field: control.checked(value) if control else value})


@dataclass(frozen=True, slots=True)
class Control:
    """How one setting is offered.

    Attributes:
        field: the setting.
        label: on the screen.
        hint: shown when the pointer rests on it.
        kind: "choice", "slider" or "switch".
        low: of a slider.
        high: of a slider.
        step: of a slider; a whole number makes the setting one.
        offered: of a choice, what there is at present: value and label of each.
        group: the folder it is in; the empty one is always open.
    """

    field: str
    label: str
    hint: str
    kind: Literal["choice", "slider", "switch"]
    low: float = 0.0
    high: float = 1.0
    step: float = 1.0
    offered: Callable[[], Choices] = tuple
    group: str = "Tune"

    @property
    def choices(self) -> Choices:
        """Value and label of each choice."""
        return self.offered()

    def checked(self, value: Any) -> Any:
        """``value`` as the setting needs it, rounded to the slider's type.

        Raises:
            SettingError: if it is out of range or not a choice.
        """
        if self.kind == "switch":
            return bool(value)
        if self.kind == "choice":
            names = [name for name, _ in self.choices]
            if value not in names:
                raise SettingError(f"{self.label}: expected one of {', '.join(names)}, got {value!r}")
            return value
        try:
            number = float(value)
        except (TypeError, ValueError, OverflowError):
            raise SettingError(f"{self.label}: expected a number, got {value!r}") from None
        if not self.low <= number <= self.high:
            raise SettingError(f"{self.label}: expected {self.low:g} to {self.high:g}, got {value!r}")
        return round(number) if self.step >= 1 else number


def _filters() -> Choices:
    return tuple((info.name, info.title) for info in FILTERS.values())


def _worlds() -> Choices:
    return tuple((world.name, world.title) for world in WORLDS.values())


def _rivals() -> Choices:
    return (NOBODY, "nothing"), *_filters(), (ITSELF, "itself, as it is now")


def _overlays() -> Choices:
    return ("none", "nothing"), ("proposal", "what the detector sees"), ("edges", "edges")


def _panes() -> Choices:
    return ("both", "both rooms"), ("toy", "the toy"), ("tracker", "the video")


_CONTROLS = (
    Control("filter", "Filter", "Runs in both rooms", "choice", offered=_filters, group=""),
    Control("world", "Toy world", "The world on the left", "choice", offered=_worlds, group=""),
    Control(
        "rival",
        "Compare with",
        "A second filter, on the same data and random numbers",
        "choice",
        offered=_rivals,
        group="",
    ),
    Control("toy_particles", "Particles, toy", "How many hypotheses in the toy", "slider", 1, 2000),
    Control("tracker_particles", "Particles, video", "How many hypotheses in the tracker", "slider", 1, 5000),
    Control(
        "system",
        "System noise ×",
        "How much the filter believes the state to move at random",
        "slider",
        0.1,
        4,
        0.05,
    ),
    Control(
        "observation",
        "Obs. noise ×",
        "How vague the filter believes what it sees to be",
        "slider",
        0.1,
        4,
        0.05,
    ),
    Control(
        "proposal",
        "Proposal width ×",
        "How widely the detector scatters its proposals",
        "slider",
        0.1,
        4,
        0.05,
    ),
    Control("speed", "Steps / second", "While playing", "slider", 0.5, 60, 0.5),
    Control("seed", "Seed", "Equal seeds, equal films", "slider", 0, 999),
    Control(
        "pane",
        "Show",
        "Which room",
        "choice",
        offered=_panes,
        group="",
    ),
    Control(
        "arrows",
        "Arrows",
        "How many associations to draw, the most probable first",
        "slider",
        0,
        600,
        group="Look",
    ),
    Control("overlay", "Over the video", "Laid over the whole frame", "choice", offered=_overlays, group="Look"),
    Control("ancestry", "Show ancestors", "Where all particles come from, back through time", "switch", group="Look"),
    Control("truth", "Show the truth", "Where it is known", "switch", group="Look"),
    Control("exact", "Show the exact posterior", "Where it is known", "switch", group="Look"),
    Control("dark", "Dark colours", "Light on dark", "switch", group="Look"),
)
GROUPS = ("", "Tune", "Look")


CONTROLS: dict[str, Control] = {control.field: control for control in _CONTROLS}
