"""The commands that do again what is on screen, and comments on what they cannot repeat."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence

from pfviz.particles import FloatArray
from pfviz.vision.limits import Limits
from pfviz_app.differences import differences
from pfviz_app.exports import BUILT_IN, changes_in_words
from pfviz_app.films import Start, VideoSetup
from pfviz_app.lane import Lane
from pfviz_app.picture import Picture
from pfviz_app.settings import Settings
from pfviz_app.start_box import USUAL, Assumptions
from pfviz_app.video_options import MEGABYTE

_NOISES = {"system": "--system-noise", "observation": "--observation-noise", "proposal": "--proposal-width"}
_LIMITS = {"max_bytes": "--max-megabytes", "max_memory": "--max-memory"}


def commands_of(picture: Picture) -> str:
    """A line for each room of each lane, with a comment before it where it cannot repeat all that is on screen."""
    lanes = [picture.lane, *([picture.rival] if picture.rival else [])]
    held = {t: place for t, place in picture.toy.film.held.items() if t <= picture.t}
    return "\n".join(line for lane in lanes for line in _of_lane(lane, picture.t, held))


def _of_lane(lane: Lane, t: int, held: Mapping[int, FloatArray]) -> Iterator[str]:
    log, film = lane.log[:t] or (lane.settings,), lane.tracker.film
    yield from toy_command(log, held)
    yield from tracker_command(log, film.setup, film.chosen_start or film.setup.start)


def toy_command(log: Sequence[Settings], held: Mapping[int, FloatArray] | None = None) -> Iterator[str]:
    """The command that runs the toy again, for the settings of the steps at t = 1, 2, ...

    Args:
        log: at least one.
        held: by time, where the target was put.
    """
    first = log[0]
    unlike = [*_unlike(log, "tracker_particles", first.world)]
    unlike += [f"the target was put elsewhere at t = {', '.join(map(str, sorted(held)))}"] if held else []
    yield from _comment(unlike)
    words = ["--world", first.world, *_filter(first, first.toy_particles), "--steps", str(len(log)), "--json"]
    yield shlex.join(["pfviz", "toy", *words])


def tracker_command(log: Sequence[Settings], setup: VideoSetup, start: Start | None = None) -> Iterator[str]:
    """The command that tracks the video again, to its end.

    Args:
        log: the settings of the steps at t = 1, 2, ..., at least one.
        setup: the video.
        start: what is followed; what the video suggests by default.
    """
    if setup.name is None:
        yield "# The video was sent by a visitor: no command can find it."
        return
    first = log[0]
    yield from _comment(_unlike(log, "toy_particles"))
    words = [*_marked(start, setup.start_frame), *_assumed(setup.assumed), *_terms(setup)]
    yield shlex.join(["pfviz", "track", setup.name, *words, *_filter(first, first.tracker_particles), "--json"])


def _unlike(log: Sequence[Settings], elsewhere: str, *names: str) -> Iterator[str]:
    """What a command cannot say; ``elsewhere`` is the setting of the other room's particles."""
    for name in (*names, log[0].filter):
        if name not in BUILT_IN:
            yield f"{name} is not part of pfviz"
    for t, text in changes_in_words(log, elsewhere):
        yield f"from step {t} on {text}"


def _comment(unlike: Iterator[str] | Sequence[str]) -> Iterator[str]:
    text = "; ".join(unlike)
    if text:
        yield f"# This cannot repeat all that is on screen: {text}."


def _filter(settings: Settings, particles: int) -> Iterator[str]:
    yield from ("--filter", settings.filter, "--particles", str(particles), "--seed", str(settings.seed))
    for name, factor in settings.noises.items():
        if factor != 1.0:
            yield from (_NOISES[name], repr(float(factor)))


def _marked(start: Start | None, start_frame: int) -> Iterator[str]:
    """Where the object is."""
    if start is not None:
        rows = (",".join(repr(float(value)) for value in row) for row in ([start.box] if start.box else start.outline))
        yield f"--{'box' if start.box else 'polygon'}={';'.join(rows)}"
    if start_frame:
        yield from ("--start-frame", str(start_frame))
    if start is not None and start.frame != start_frame:
        yield from ("--learn-frame", str(start.frame))


def _assumed(assumed: Assumptions) -> Iterator[str]:
    for name, value in differences(assumed, USUAL, ("model", "shape", "dynamics", "working_width")).items():
        yield from (f"--{name.replace('_', '-')}", str(value))
    if assumed.learnt_from is not None:
        yield from ("--learn-dynamics", assumed.learnt_from)
    if not assumed.restart:
        yield "--no-restart"


def _terms(setup: VideoSetup) -> Iterator[str]:
    """How the file is read."""
    for name, value in differences(setup.limits, Limits()).items():
        option = _LIMITS.get(name, f"--{name.replace('_', '-')}")
        yield from (option, str(value // MEGABYTE if name in _LIMITS else value))
    if setup.frame_rate is not None:
        yield from ("--frame-rate", repr(setup.frame_rate))
