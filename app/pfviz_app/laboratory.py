"""The tab in which a visitor runs a small experiment in the background and watches its figure grow."""

from __future__ import annotations

import html
import logging
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import viser

from pfviz.experiments import (
    EXPERIMENTS,
    KNOBS,
    Experiment,
    ExperimentError,
    LiveExperiment,
    Progress,
    Summary,
    comparison,
    get_small_experiment,
    plain_arms,
)
from pfviz.experiments.charts import pixels_of
from pfviz_app.commands import Ask, Command
from pfviz_app.framing import framed
from pfviz_app.picture import Picture
from pfviz_app.sending import send
from pfviz_app.settings import ITSELF, NOBODY

log = logging.getLogger(__name__)

_AT_ONCE = 2
_FEWEST_SEEDS, _MOST_SEEDS = 2, 50
_FREE = threading.BoundedSemaphore(_AT_ONCE)
_PERIOD = 1.5
_RUN, _CANCEL = "▶ Run", "■ Cancel"
_HERE = {f"error against {text}": knob for knob, text in KNOBS.items()}
_PAPERS = {f"{experiment.title} (small)": name for name, experiment in EXPERIMENTS.items()}
_OTHERS = ("condensation", "basic-sir", "rb-hs-sir")
_FACTORS = (0.25, 0.5, 1.0, 2.0, 4.0)


class Laboratory:
    """A visitor's experiments: one at a time, and few at a time of all visitors."""

    def __init__(self, client: viser.ClientHandle, post: Callable[[Command], None]) -> None:
        self._post = post
        self._live: LiveExperiment | None = None
        self._running = self._closed = False
        self._shown_at = 0.0
        gui = client.gui
        self._what = gui.add_dropdown("Experiment", (*_HERE, *_PAPERS))
        self._where = gui.add_dropdown("Where", ("toy", "video"), hint="With the settings that are on now")
        self._seeds = gui.add_slider("Seeds", _FEWEST_SEEDS, _MOST_SEEDS, 1, 5, hint="How many runs of everything")
        self._button = gui.add_button(_RUN)
        self._bar = gui.add_progress_bar(0.0, visible=False, animated=True)
        self._figure = gui.add_image(np.full((2, 2, 3), 255, np.uint8), visible=False)
        self._text = gui.add_html(framed("Runs in the background, with the settings that are on now."))

        @self._button.on_click
        async def _(_: object) -> None:
            if self._live is not None:
                self._live.cancel()
            else:
                self._post(Ask(self._run))

    def close(self) -> None:
        """End what runs."""
        self._closed = True
        if self._live is not None:
            self._live.cancel()

    def _run(self, picture: Picture) -> None:
        if self._running or self._closed:
            return
        if not _FREE.acquire(blocking=False):
            self._say(f"{_AT_ONCE} experiments run already, of other visitors: try again when they are done.")
            return
        try:
            experiment = self._experiment(picture)
            self._button.label, self._bar.value, self._bar.visible = _CANCEL, 0.0, True
            self._running = True
            self._live = LiveExperiment(experiment, self._seeds_wanted, self._progressed)
            if not self._running:  # it is over already
                self._live = None
        except Exception as error:
            _FREE.release()
            self._running = False
            self._button.label, self._bar.visible = _RUN, False
            if not isinstance(error, ValueError):
                raise
            self._say(str(error))

    @property
    def _seeds_wanted(self) -> int:
        """As many as the slider allows: a page can send any number."""
        return min(max(int(self._seeds.value), _FEWEST_SEEDS), _MOST_SEEDS)

    def _experiment(self, picture: Picture) -> Experiment:
        """What is chosen, with the settings on screen where it is not one of the sources'."""
        if self._what.value in _PAPERS:
            return get_small_experiment(_PAPERS[self._what.value])
        s, knob = picture.settings, _HERE[self._what.value]
        place, particles = s.world, s.toy_particles
        if self._where.value == "video":
            place, particles = picture.tracker.film.place, s.tracker_particles
        if place is None:
            raise ExperimentError(
                "Experiments know the truth about the scenes alone, followed as they suggest: take one, or the toy."
            )
        rivals = [s.rival] if s.rival not in (NOBODY, ITSELF) else [name for name in _OTHERS if name != s.filter]
        values = [max(round(particles * factor), 1) for factor in _FACTORS] if knob == "particles" else _FACTORS
        noises: dict[str, Any] = {name: factor for name, factor in s.noises.items() if name != knob}
        return comparison(place, plain_arms([s.filter, *rivals], particles), knob, values, **noises)

    def _progressed(self, progress: Progress) -> None:
        """Called in the experiment's thread. Whatever cannot be shown, at the end there is room for others."""
        over, now = progress.state != "running", time.monotonic()
        try:
            if over or now - self._shown_at > _PERIOD:
                self._shown_at = now
                send(lambda: self._show_progress(progress))
        except Exception:
            log.exception("an experiment cannot be shown")
        finally:
            if over:
                self._running = False
                self._live = None
                _FREE.release()
                send(lambda: self._end(progress))

    def _show_progress(self, progress: Progress) -> None:
        self._bar.value = round(100.0 * progress.share)
        if self._live is not None and progress.rows:
            self._show(self._live.summary)

    def _end(self, progress: Progress) -> None:
        self._button.label, self._bar.visible = _RUN, False
        if progress.error:
            self._say(progress.error)

    def _show(self, summary: Summary) -> None:
        sentences = "".join(f"<li>{html.escape(sentence)}</li>" for sentence in summary.sentences[:12])
        self._text.content = framed(f'<ul style="margin:0;padding-left:16px">{sentences}</ul>')
        if summary.figures:
            self._figure.image = pixels_of(summary.figures[0])
            self._figure.visible = True

    def _say(self, message: str) -> None:
        self._text.content = framed(f"<b>{html.escape(message)}</b>")
