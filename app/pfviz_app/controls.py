"""The widgets: what a visitor does becomes a command, what the session decides is shown."""

from __future__ import annotations

import html
import threading
import time
from collections.abc import Callable, Coroutine
from contextlib import nullcontext
from dataclasses import fields
from typing import Any

import viser

from pfviz import kernels
from pfviz.worlds import WORLDS
from pfviz_app.algorithms import algorithm
from pfviz_app.commands import Arrange, Command, Keep, Play, Reset, Seek, Set, Step, Walk
from pfviz_app.comparison import comparison_html
from pfviz_app.explanations import explanation, legend
from pfviz_app.guide import show_guide
from pfviz_app.laboratory import Laboratory
from pfviz_app.own_video import OwnVideo
from pfviz_app.picture import Picture
from pfviz_app.plots import Plots
from pfviz_app.receipt import Receipt, receipt, receipt_html
from pfviz_app.scenarios import SCENARIOS
from pfviz_app.settings import CONTROLS, GROUPS, Control, Settings
from pfviz_app.sharing import Sharing
from pfviz_app.stage.layout import PHONE

Post = Callable[[Command], None]
_TWO_DOCKS = 1150
_PERIOD = 0.2
_LAST_STAGE, _NEXT_STAGE = "‹ before", "after ›"
_BACK, _STEP, _RESET = "◀ Back", "Step ▶", "↺ Reset"
_BRANCH, _HELP = "Branch here", "Help, keys"
_NO_SITUATION = "choose one …"
_SITUATIONS = {scenario.title: scenario.name for scenario in SCENARIOS.values()}

_KEEP_ARROW_KEYS = """<img src="data:," alt="" hidden onerror="
  const keep = mine => event => { if (event.key.startsWith('Arrow') && mine(event.target)) event.stopPropagation(); };
  document.body.addEventListener('keydown', keep(target => target.closest('.mantine-Slider-root')));
  document.documentElement.addEventListener('keydown', keep(target => true));
">"""
"""Arrow keys move a slider that has the focus and are shortcuts otherwise: viser would turn the camera, too.

viser's shortcuts listen on the document's root element, its camera on the document.
"""


class Controls:
    """One visitor's docks: what to look for and the plots, and the controls.

    Callbacks are coroutines: viser runs these one by one in the order of what the visitor did, and plain functions in
    a pool of threads, in any order.
    """

    def __init__(
        self,
        client: viser.ClientHandle,
        settings: Settings,
        post: Post,
        idle: Callable[[], bool],
        straighten: Callable[[], None],
    ) -> None:
        self._client, self._post, self._idle = client, post, idle
        self._widgets: dict[str, Any] = {}
        self._agreed: dict[int, Any] = {}
        self._agreeing = threading.Lock()
        self._labels = {field: dict(control.choices) for field, control in CONTROLS.items()}
        self._explained: Any = None
        self._dark: bool | None = None
        self._state: Any = None
        self._shown_at = 0.0
        self._theme(settings.dark)
        self._controls(settings, straighten)
        self._text_and_plots()
        self._shortcuts(straighten)

    def close(self) -> None:
        """The visitor has left."""
        self._laboratory.close()
        self._sharing.close()
        self._video.close()

    def show(self, picture: Picture) -> None:
        """Bring the widgets in line with the session; those that a film on its way moves, now and then."""
        if picture.settings.dark != self._dark:
            self._theme(picture.settings.dark)
        state, now = (picture.settings, picture.situation, picture.playing), time.monotonic()
        if not picture.playing or state != self._state or now - self._shown_at > _PERIOD:
            self._state, self._shown_at = state, now
            self._show_widgets(picture)
        self._show_status(picture)
        self._sharing.show(picture)
        self._video.show(picture)
        self._explain(picture)
        self._plots.draw(picture)

    def _show_widgets(self, picture: Picture) -> None:
        for field, widget in self._widgets.items():
            self._set(widget, self._shown(field, getattr(picture.settings, field)))
        situation = SCENARIOS[picture.situation].title if picture.situation else _NO_SITUATION
        self._set(self._situation, situation)
        self._put(self._play, "label", "❚❚ Pause" if picture.playing else "▶ Play")
        self._put(self._time, "max", max(picture.last, 1))
        self._set(self._time, picture.t)

    def _show_status(self, picture: Picture) -> None:
        working = picture.progress is not None
        self._put(self._progress, "visible", working)
        if picture.progress is not None:
            self._put(self._progress, "value", round(100.0 * picture.progress))
        status = html.escape(picture.message) or (
            "Working …" if working else "Playing" if picture.playing else "Paused"
        )
        status = f"<b>{status}</b>" if picture.message else status
        if picture.lane.plain:
            ready = "ready: Reset uses them" if kernels.compiled_ready() else "being compiled"
            status += f'<br><span style="opacity:.7">The fast loops are {ready}.</span>'
        self._put(self._status, "content", f'<div style="padding:0 12px;font-size:13.5px">{status}</div>')

    @staticmethod
    def _put(handle: Any, name: str, value: Any) -> None:
        """Set a property, unless it has that value: viser sends whatever is set."""
        if getattr(handle, name) != value:
            setattr(handle, name, value)

    def _set(self, widget: Any, value: Any) -> None:
        """Show ``value``, unless the visitor has moved the widget meanwhile: it must not jump back under their hand.

        The widget itself already holds what they have moved it to before their wish arrives here, so it is compared
        with what was last agreed on. Another picture, and with it another call, follows as soon as the wish is done.
        """
        with self._agreeing:
            if self._agreed[id(widget)] != value and self._idle():
                widget.value = value
                self._agreed[id(widget)] = value

    def _explain(self, picture: Picture) -> None:
        s = picture.settings
        shown = (s.filter, s.world, s.dark, picture.situation)
        if shown != self._explained:
            self._explained = shown
            self._text.content = explanation(s.filter, picture.situation)
            self._world.content = (
                f"**{WORLDS[s.world].title}.** {WORLDS[s.world].look_for}" if s.world in WORLDS else ""
            )
            self._legend.content = legend(s.dark)
        self._put(self._receipt, "content", receipt_html(_receipt(picture), s.dark))
        self._put(self._algorithm, "content", algorithm(s.filter, picture.stage, s.dark))
        if not picture.playing or picture.t % 5 == 0 or picture.rival is None:
            self._put(self._comparison, "content", comparison_html(picture))

    def _theme(self, dark: bool) -> None:
        self._dark = dark
        self._client.gui.configure_theme(
            dark_mode=dark, show_logo=False, show_share_button=False, brand_color=(0, 114, 178)
        )

    def _text_and_plots(self) -> None:
        """In a dock of their own on the left, or under the controls where the window is too narrow for two docks."""
        gui = self._client.gui
        text = gui.add_panel(order=1)
        with text.add_tab("Look for"):
            self._text = gui.add_markdown("")
            self._algorithm = gui.add_html("")
            self._world = gui.add_markdown("")
        with text.add_tab("Receipt"):
            self._receipt = gui.add_html("")
        with text.add_tab("Compare"):
            self._comparison = gui.add_html("")
        with text.add_tab("Colours"):
            self._legend = gui.add_html("")
        plots = gui.add_panel(order=2)
        self._plots = Plots(self._client, plots)
        with plots.add_tab("Experiment"):
            self._laboratory = Laboratory(self._client, self._post)
        if self._client.camera.image_width >= _TWO_DOCKS:
            text.dock_left()
            text.set_width(310)
        else:
            text.dock_below(gui.main_panel)
        plots.dock_below(text)

    def _controls(self, settings: Settings, straighten: Callable[[], None]) -> None:
        gui = self._client.gui
        gui.set_panel_label("pfviz")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(330)
        self._moves()
        phone = self._client.camera.image_width < PHONE
        self._add(CONTROLS["filter"], settings)
        with gui.add_folder("More", expand_by_default=False) if phone else nullcontext():
            self._choices(settings, phone)

    def _choices(self, settings: Settings, phone: bool) -> None:
        """All that is not needed all the time; on a phone it is folded away."""
        gui = self._client.gui
        self._situation = gui.add_dropdown(
            "Situation", (_NO_SITUATION, *_SITUATIONS), initial_value=_NO_SITUATION, hint="Each with what to look for"
        )
        self._wishing(self._situation, lambda title: Arrange(_SITUATIONS[title]) if title in _SITUATIONS else Reset())
        for group in GROUPS:
            members = [control for control in CONTROLS.values() if control.group == group and control.field != "filter"]
            folder = gui.add_folder(group, expand_by_default=group == "Tune" and not phone) if group else nullcontext()
            with folder:
                for control in members:
                    self._add(control, settings)
        self._video = OwnVideo(self._client, self._post)
        self._sharing = Sharing(self._client, self._post)

    def _moves(self) -> None:
        """What moves through time."""
        gui = self._client.gui
        self._play = gui.add_button("▶ Play", hint="Space", color=(0, 114, 178))
        self._play.on_click(self._posting(Play))
        moves = gui.add_button_group("", (_BACK, _STEP, _RESET))
        commands: dict[str, Command] = {_BACK: Step(-1), _STEP: Step(1), _RESET: Reset()}
        moves.on_click(self._posting(lambda: commands[moves.value]))
        walks = gui.add_button_group("Stage", (_LAST_STAGE, _NEXT_STAGE))
        walks.on_click(self._posting(lambda: Walk(1 if walks.value == _NEXT_STAGE else -1)))
        more = gui.add_button_group("", (_BRANCH, _HELP))
        more.on_click(self._calling(lambda: self._post(Keep()) if more.value == _BRANCH else show_guide(self._client)))
        self._time = gui.add_slider("Time", min=0, max=1, step=1, initial_value=0, hint="What is recorded so far")
        self._wishing(self._time, Seek)
        self._status = gui.add_html("Paused")
        self._progress = gui.add_progress_bar(0.0, visible=False, animated=True)

    def _add(self, control: Control, settings: Settings) -> None:
        gui, field = self._client.gui, control.field
        value = self._shown(field, getattr(settings, field))
        if control.kind == "choice":
            labels = [label for _, label in control.choices]
            widget: Any = gui.add_dropdown(control.label, labels, initial_value=value, hint=control.hint)
        elif control.kind == "switch":
            widget = gui.add_checkbox(control.label, value, hint=control.hint)
        else:
            whole = control.step >= 1
            low, high, step = (int(v) if whole else v for v in (control.low, control.high, control.step))
            widget = gui.add_slider(control.label, low, high, step, value, hint=control.hint)
        self._widgets[field] = widget
        self._wishing(widget, lambda value: Set(field, self._meant(field, value)))

    def _posting(self, command: Callable[[], Command]) -> Callable[[Any], Coroutine[Any, Any, None]]:
        return self._calling(lambda: self._post(command()))

    @staticmethod
    def _calling(action: Callable[[], None]) -> Callable[[Any], Coroutine[Any, Any, None]]:
        async def on_event(_: Any) -> None:
            action()

        return on_event

    def _wishing(self, widget: Any, command: Callable[[Any], Command]) -> None:
        """Pass on what a visitor sets a widget to; our own updates come without a client."""
        self._agreed[id(widget)] = widget.value

        async def on_update(event: Any) -> None:
            if event.client is not None:
                with self._agreeing:
                    value = self._agreed[id(widget)] = widget.value
                self._post(command(value))

        widget.on_update(on_update)

    def _shown(self, field: str, value: Any) -> Any:
        return self._labels[field].get(value, value)

    def _meant(self, field: str, shown: Any) -> Any:
        return next((name for name, label in self._labels[field].items() if label == shown), shown)

    def _shortcuts(self, straighten: Callable[[], None]) -> None:
        keys: tuple[tuple[str, Any, Command], ...] = (
            ("Play or pause", "space", Play()),
            ("Step", "arrowright", Step(1)),
            ("Step back", "arrowleft", Step(-1)),
            ("Next stage", "arrowdown", Walk(1)),
            ("Stage before", "arrowup", Walk(-1)),
            ("Reset", "R", Reset()),
            ("Branch from here", "B", Keep()),
        )
        for label, key, command in keys:
            handle = self._client.gui.add_command(label, hotkey=key)
            handle.on_trigger(self._posting(lambda command=command: command))
        straight = self._client.gui.add_command("Straighten the picture", hotkey="F")
        straight.on_trigger(self._calling(straighten))
        guide = self._client.gui.add_command("Help and keys", hotkey="H")
        guide.on_trigger(self._calling(lambda: show_guide(self._client)))
        self._client.gui.add_html(_KEEP_ARROW_KEYS)


def _receipt(picture: Picture) -> Receipt | None:
    """The receipt of the particle that was clicked."""
    if picture.chosen is None or not picture.t:
        return None
    lane = picture.rival if picture.chosen.rival and picture.rival else picture.lane
    room = lane.toy if picture.chosen.room == "toy" else lane.tracker
    return receipt(room.trace[picture.t], picture.chosen.index)


assert {f.name for f in fields(Settings)} == set(CONTROLS), "every setting has a control"
