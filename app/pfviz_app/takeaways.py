"""What a visitor can take along of the picture on screen: its name as a file, and how it is made."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

from pfviz.figures import render
from pfviz.filters import FILTERS
from pfviz_app import exports
from pfviz_app.background import Tell
from pfviz_app.picture import Picture


def _figure(of: Callable[..., object], extension: str, picture: Picture) -> bytes:
    return render(of(picture), extension)  # type: ignore[arg-type]


def _toy(picture: Picture) -> object:
    _need_a_step(picture)
    s = picture.settings
    return exports.toy_figure(picture.toy, picture.t, s.truth, s.exact)


def _video_frame(picture: Picture) -> object:
    _need_a_step(picture)
    return exports.tracker_figure(picture.tracker, picture.t, picture.settings.truth)


def _courses(room: str, picture: Picture) -> object:
    _need_a_step(picture)
    lanes = [picture.lane, *([picture.rival] if picture.of_rival() and picture.rival else [])]
    names = [FILTERS[getattr(lane, room).outcome(picture.t).filter_name].title for lane in lanes]
    labels = names if len(set(names)) == len(names) else [f"{name}{', kept' * i}" for i, name in enumerate(names)]
    rooms = {label: getattr(lane, room) for label, lane in zip(labels, lanes, strict=True)}
    return exports.courses_figure(rooms, picture.t)


def _toy_script(picture: Picture) -> bytes:
    log = picture.lane.log[: max(picture.t, 1)]
    return exports.toy_script(log, picture.toy.film.held, picture.lane.plain).encode()


def _tracker_script(picture: Picture) -> bytes:
    film, setup = picture.tracker.film, picture.tracker.film.setup
    if setup.name is None:
        raise ValueError("This video was sent by you and is not on the server: a script could not find it.")
    return exports.tracker_script(
        picture.lane.log[: max(picture.t, 1)],
        setup.name,
        film.chosen_start or setup.start,
        setup.start_frame,
        picture.lane.plain,
        assumed=setup.assumed,
        limits=setup.limits,
        frame_rate=setup.frame_rate,
    ).encode()


def _json(picture: Picture) -> bytes:
    return exports.run_json(picture.lane.log, picture.toy, picture.tracker, picture.toy.film.held).encode()


def _weights(room: str, picture: Picture) -> bytes:
    _need_a_step(picture)
    return "".join(exports.trace_csv(getattr(picture, room))).encode()


def _steps(room: str, picture: Picture) -> bytes:
    _need_a_step(picture)
    return "".join(exports.summary_csv(getattr(picture, room))).encode()


def _video(picture: Picture) -> Callable[[Tell], bytes]:
    """What makes the video of all that is recorded now, whatever becomes of the picture's rooms."""
    recorded = picture.tracker.trace
    if not len(recorded):
        raise ValueError("There is nothing to take yet: take a step first.")
    room = picture.tracker.fork(recorded.last)

    def make(tell: Tell) -> bytes:
        with tempfile.TemporaryDirectory(prefix="pfviz-") as folder:
            path = Path(folder) / "pfviz.mp4"
            exports.write_video(room, path, tell)
            return path.read_bytes()

    return make


def _need_a_step(picture: Picture) -> None:
    if not picture.t:
        raise ValueError("There is nothing to take yet: take a step first.")


_FIGURES: dict[str, tuple[str, Callable[[Picture], object]]] = {
    "Figure of the toy": ("pfviz-toy", _toy),
    "Figure of the video": ("pfviz-video", _video_frame),
    "Curves of the toy": ("pfviz-toy-curves", partial(_courses, "toy")),
    "Curves of the video": ("pfviz-video-curves", partial(_courses, "tracker")),
}
TAKEAWAYS: dict[str, tuple[str, Callable[[Picture], bytes]]] = {
    f"{title}, {extension.upper()}": (f"{stem}.{extension}", partial(_figure, of, extension))
    for title, (stem, of) in _FIGURES.items()
    for extension in ("png", "svg", "pdf")
} | {
    "Python script, toy": ("pfviz_toy.py", _toy_script),
    "Python script, video": ("pfviz_video.py", _tracker_script),
    "Settings and summary, JSON": ("pfviz.json", _json),
    "All weights of the toy, CSV": ("pfviz-toy-weights.csv", partial(_weights, "toy")),
    "All weights of the video, CSV": ("pfviz-video-weights.csv", partial(_weights, "tracker")),
    "Steps of the toy, CSV": ("pfviz-toy-steps.csv", partial(_steps, "toy")),
    "Steps of the video, CSV": ("pfviz-video-steps.csv", partial(_steps, "tracker")),
}
"""By what is offered: the name of the file, and its content for a picture.

Raises:
    ValueError: in words for the visitor, where there is nothing to take.
"""
SLOW_TAKEAWAYS: dict[str, tuple[str, Callable[[Picture], Callable[[Tell], bytes]]]] = {
    "Annotated video, MP4": ("pfviz.mp4", _video),
}
"""The same of what takes long: for a picture, what makes the content in any thread, telling how far it is.

Raises:
    ValueError: in words for the visitor, where there is nothing to take.
"""
