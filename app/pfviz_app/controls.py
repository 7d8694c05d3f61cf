"""The widgets: what a visitor does becomes a command, what the session decides is shown."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from contextlib import nullcontext
from dataclasses import fields
from typing import Any

import viser

from pfviz.worlds import WORLDS
from pfviz_app.algorithms import algorithm
from pfviz_app.commands import Command, Open, Play, Reset, Seek, Set, Step, Walk
from pfviz_app.explanations import explanation, legend
from pfviz_app.picture import Picture
from pfviz_app.plots import Plots
from pfviz_app.receipt import Receipt, receipt, receipt_html
from pfviz_app.settings import CONTROLS, GROUPS, Control, Settings, command_line
from pfviz_app.share import Shared, encode
from pfviz_app.stage.layout import PHONE

Post = Callable[[Command], None]
_TWO_DOCKS = 1150
_LAST_STAGE, _NEXT_STAGE = "‹ before", "after ›"
_BACK, _STEP, _RESET = "◀ Back", "Step ▶", "↺ Reset"

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

    def __init__(self, client: viser.ClientHandle, settings: Settings, post: Post, idle: Callable[[], bool]) -> None:
        self._client, self._post, self._idle = client, post, idle
        self._widgets: dict[str, Any] = {}
        self._agreed: dict[int, Any] = {}
        self._labels = {field: dict(control.choices) for field, control in CONTROLS.items()}
        self._explained: tuple[str, str, bool] | None = None
        self._dark: bool | None = None
        self._shared: Shared | None = None
        self._theme(settings.dark)
        self._controls(settings)
        self._text_and_plots()
        self._shortcuts()

    def show(self, picture: Picture) -> None:
        """Bring the widgets in line with the session."""
        s = picture.settings
        if s.dark != self._dark:
            self._theme(s.dark)
        for field, widget in self._widgets.items():
            value = self._shown(field, getattr(s, field))
            self._set(widget, value)
        label = "❚❚ Pause" if picture.playing else "▶ Play"
        if self._play.label != label:
            self._play.label = label
        self._show_time(picture)
        self._show_code(picture)
        status = picture.message or ("Playing" if picture.playing else "Paused")
        status = f"**{status}**" if picture.message else status
        if self._status.content != status:
            self._status.content = status
        self._explain(picture)
        self._plots.draw(picture)

    def _show_time(self, picture: Picture) -> None:
        most = max(picture.last, 1)
        if self._time.max != most:
            self._time.max = most
        self._set(self._time, picture.t)

    def _set(self, widget: Any, value: Any) -> None:
        """Show ``value``, unless the visitor has moved the widget meanwhile: it must not jump back under their hand.

        The widget itself already holds what they have moved it to before their wish arrives here, so it is compared
        with what was last agreed on. Another picture, and with it another call, follows as soon as the wish is done.
        """
        if self._agreed.get(id(widget), widget.value) != value and self._idle():
            widget.value = value
            self._agreed[id(widget)] = value

    def _show_code(self, picture: Picture) -> None:
        """The share code of what is on screen, unless the visitor is typing one or the film runs."""
        if picture.playing or picture.shared == self._shared:
            return
        self._shared = picture.shared
        self._code.value = encode(self._shared)
        self._line.value = command_line(picture.settings, picture.t)

    def _explain(self, picture: Picture) -> None:
        s = picture.settings
        if (s.filter, s.world, s.dark) != self._explained:
            self._explained = (s.filter, s.world, s.dark)
            self._text.content = explanation(s.filter)
            self._world.content = f"**{WORLDS[s.world].title}.** {WORLDS[s.world].look_for}"
            self._legend.content = legend(s.dark)
        slip = receipt_html(_receipt(picture), s.dark)
        if self._receipt.content != slip:
            self._receipt.content = slip
        lines = algorithm(s.filter, picture.stage, s.dark)
        if self._algorithm.content != lines:
            self._algorithm.content = lines

    def _theme(self, dark: bool) -> None:
        self._dark = dark
        self._client.gui.configure_theme(
            dark_mode=dark, show_logo=False, show_share_button=False, brand_color=(0, 114, 178)
        )

    def _text_and_plots(self) -> None:
        """In a dock of their own on the left, or under the controls where the window is too narrow for two docks."""
        gui = self._client.gui
        text = gui.add_panel(order=1)
        with text.add_tab("What to look for"):
            self._text = gui.add_markdown("")
            self._algorithm = gui.add_html("")
            self._world = gui.add_markdown("")
        with text.add_tab("Receipt"):
            self._receipt = gui.add_html("")
        with text.add_tab("Colours"):
            self._legend = gui.add_html("")
        plots = gui.add_panel(order=2)
        with plots.add_tab("Over time"):
            self._plots = Plots(self._client)
        if self._client.camera.image_width >= _TWO_DOCKS:
            text.dock_left()
            text.set_width(290)
        else:
            text.dock_below(gui.main_panel)
        plots.dock_below(text)

    def _controls(self, settings: Settings) -> None:
        gui = self._client.gui
        gui.set_panel_label("pfviz")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(330)
        self._play = gui.add_button("▶ Play", hint="Space", color=(0, 114, 178))
        self._play.on_click(self._posting(lambda: Play()))
        moves = gui.add_button_group("", (_BACK, _STEP, _RESET))
        commands: dict[str, Command] = {_BACK: Step(-1), _STEP: Step(1), _RESET: Reset()}
        moves.on_click(self._posting(lambda: commands[moves.value]))
        walks = gui.add_button_group("Stage", (_LAST_STAGE, _NEXT_STAGE))
        walks.on_click(self._posting(lambda: Walk(1 if walks.value == _NEXT_STAGE else -1)))
        self._time = gui.add_slider("Time", min=0, max=1, step=1, initial_value=0, hint="What is recorded so far")
        self._wishing(self._time, Seek)
        self._status = gui.add_markdown("Paused")
        phone = self._client.camera.image_width < PHONE
        for group in GROUPS:
            members = [control for control in CONTROLS.values() if control.group == group]
            folder = gui.add_folder(group, expand_by_default=group != "More" and not phone) if group else nullcontext()
            with folder:
                for control in members:
                    self._add(control, settings)

        with gui.add_folder("Share", expand_by_default=False):
            self._code = gui.add_text("Code", "", hint="Brings back exactly this: settings, seed and time")
            gui.add_button("Open this code").on_click(self._posting(lambda: Open(self._code.value)))
            self._line = gui.add_text("Command", "", hint="The same run of the toy on the command line")

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
        async def on_event(_: Any) -> None:
            self._post(command())

        return on_event

    def _wishing(self, widget: Any, command: Callable[[Any], Command]) -> None:
        """Pass on what a visitor sets a widget to; our own updates come without a client."""
        self._agreed[id(widget)] = widget.value

        async def on_update(event: Any) -> None:
            if event.client is not None:
                value = widget.value
                self._post(command(value))
                self._agreed[id(widget)] = value

        widget.on_update(on_update)

    def _shown(self, field: str, value: Any) -> Any:
        return self._labels[field].get(value, value)

    def _meant(self, field: str, shown: Any) -> Any:
        return next((name for name, label in self._labels[field].items() if label == shown), shown)

    def _shortcuts(self) -> None:
        keys: tuple[tuple[str, Any, Command], ...] = (
            ("Play or pause", "space", Play()),
            ("Step", "arrowright", Step(1)),
            ("Step back", "arrowleft", Step(-1)),
            ("Next stage", "arrowdown", Walk(1)),
            ("Stage before", "arrowup", Walk(-1)),
            ("Reset", "R", Reset()),
        )
        for label, key, command in keys:
            handle = self._client.gui.add_command(label, hotkey=key)
            handle.on_trigger(self._posting(lambda command=command: command))
        self._client.gui.add_html(_KEEP_ARROW_KEYS)


def _receipt(picture: Picture) -> Receipt | None:
    """The receipt of the particle that was clicked."""
    if picture.chosen is None or not picture.t:
        return None
    room = picture.toy if picture.chosen.room == "toy" else picture.tracker
    return receipt(room.trace[picture.t], picture.chosen.index)


assert {f.name for f in fields(Settings)} == set(CONTROLS), "every setting has a control"
