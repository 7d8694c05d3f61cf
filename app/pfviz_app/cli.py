"""The command line: ``pfviz serve``, ``toy``, ``track``, ``experiment``, ``worlds``, ``filters``,
``models``.

Every error a user can make ends in one line on stderr, ``pfviz: error: ...``, and exit code 2.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NoReturn

from pfviz.filters import FILTERS
from pfviz.names import find
from pfviz.worlds import WORLDS

SOURCE_HELP = "a video file, an image, a folder of images or a pattern like 'frames/*.png', camera:N or scene:NAME"
_PAIR = re.compile(r"[-+.0-9eE]+,[-+.0-9eE]+")


class _OneLineParser(argparse.ArgumentParser):
    """A parser whose errors are one line, without the usage before it."""

    def error(self, message: str) -> NoReturn:
        fail(message.removeprefix("argument ").replace("\n", " "))


def fail(message: str) -> NoReturn:
    """Say what is wrong in one line and exit with code 2."""
    print(f"pfviz: error: {message}", file=sys.stderr)
    raise SystemExit(2)


def whole_number(least: int, most: int) -> Callable[[str], int]:
    """An option's type: a whole number between ``least`` and ``most``."""

    def parse(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = least - 1
        if not least <= value <= most:
            raise argparse.ArgumentTypeError(f"expected a whole number from {least} to {most}, got {text!r}")
        return value

    return parse


def box(text: str) -> tuple[float, float, float, float]:
    """An option's type: ``x,y,w,h`` in pixels, of positive size."""
    try:
        x, y, w, h = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected x,y,w,h in pixels, got {text!r}") from None
    if not (abs(x) < 1e6 and abs(y) < 1e6 and 0 < w < 1e6 and 0 < h < 1e6):
        raise argparse.ArgumentTypeError(f"expected x,y,w,h with a positive width and height, got {text!r}")
    return x, y, w, h


def polygon(text: str) -> tuple[tuple[float, float], ...]:
    """An option's type: ``x,y;x,y;...`` in pixels, at least three points that enclose an area."""
    try:
        points = [tuple(float(part) for part in pair.split(",")) for pair in text.split(";")]
        corners = tuple((x, y) for x, y in points if abs(x) < 1e6 and abs(y) < 1e6)
    except ValueError:
        corners = points = ()
    if len(corners) < 3 or len(corners) != len(points):
        raise argparse.ArgumentTypeError(f"expected x,y;x,y;... with at least three points in pixels, got {text!r}")
    following = (*corners[1:], corners[0])
    area = sum(x * v - u * y for (x, y), (u, v) in zip(corners, following, strict=True)) / 2.0
    if abs(area) < 1.0:
        raise argparse.ArgumentTypeError(f"expected an outline that encloses an area, got {text!r}")
    return corners


def real_number(least: float, most: float) -> Callable[[str], float]:
    """An option's type: a number between ``least`` and ``most``."""

    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not least <= value <= most:
            raise argparse.ArgumentTypeError(f"expected a number from {least:g} to {most:g}, got {text!r}")
        return value

    return parse


def known(table: dict[str, Any], kind: str) -> Callable[[str], str]:
    """An option's type: a name in ``table``; the error suggests the nearest."""

    def parse(text: str) -> str:
        try:
            find(table, text, kind)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from None
        return text

    return parse


particles = whole_number(1, 1_000_000)
seed = whole_number(0, 2**63 - 1)


def build_parser() -> argparse.ArgumentParser:
    """The whole command line."""
    parser = _OneLineParser(prog="pfviz", description="See inside particle filters.")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", parser_class=_OneLineParser)
    _add_serve(commands)
    _add_toy(commands)
    _add_track(commands)
    _add_experiment(commands)
    for name, what in (
        ("worlds", "the toy worlds"),
        ("filters", "the filters"),
        ("models", "what `pfviz track` can assume of an object"),
    ):
        command = commands.add_parser(name, help=f"list {what}")
        command.add_argument("--json", action="store_true", help="as JSON Lines")
    return parser


def _add_filter_options(command: argparse.ArgumentParser, default_particles: int | None) -> None:
    filter_name = known(FILTERS, "filter")
    command.add_argument("--filter", type=filter_name, default="rb-ss-hs-sir", metavar="NAME", help="`pfviz filters`")
    command.add_argument("--particles", type=particles, default=default_particles, metavar="N")
    command.add_argument("--seed", type=seed, default=0, metavar="S")


def _add_noises(command: argparse.ArgumentParser) -> None:
    """What the filter believes, as the sliders of the app have it."""
    group = command.add_argument_group("what the filter believes, whatever the data is like")
    for option, name, what in (
        ("--system-noise", "system", "how much the state moves at random"),
        ("--observation-noise", "observation", "how vague what it sees is"),
        ("--proposal-width", "proposal", "how widely the detector scatters its proposals"),
    ):
        help_ = f"factor on {what} (default: 1)"
        group.add_argument(option, dest=name, type=real_number(0.01, 100.0), default=1.0, metavar="X", help=help_)


def _add_serve(commands: Any) -> None:
    serve = commands.add_parser("serve", help="open the app in the browser (the default command)")
    serve.add_argument("--host", default="127.0.0.1", help="address to listen on (default: this machine only)")
    serve.add_argument("--port", type=whole_number(1, 65535), default=None, help="default: 8080, or the next free one")
    serve.add_argument(
        "--world", type=known(WORLDS, "world"), default="figure-1", metavar="NAME", help="`pfviz worlds`"
    )
    serve.add_argument("--video", default="scene:twin", metavar="SOURCE", help=SOURCE_HELP)
    _add_filter_options(serve, None)
    serve.add_argument("--no-browser", action="store_true", help="do not open a browser")
    _add_object(serve)
    _add_noises(serve)
    _add_limits(serve, "limits on the video, and on those that visitors send")


def _add_toy(commands: Any) -> None:
    toy = commands.add_parser("toy", help="run a filter on a toy world, as JSON Lines")
    toy.add_argument("--world", type=known(WORLDS, "world"), default="linear-gaussian", metavar="NAME")
    _add_filter_options(toy, 100)
    toy.add_argument("--steps", type=whole_number(1, 1_000_000), default=20, metavar="T")
    toy.add_argument("--repeat", type=whole_number(1, 1_000_000), default=1, metavar="R", help="seeds S, S+1, ...")
    toy.add_argument("--json", action="store_true", help="JSON Lines on stdout instead of a table")
    _add_noises(toy)


def _add_track(commands: Any) -> None:
    track = commands.add_parser("track", help="track an object in a video")
    track.add_argument("source", metavar="SOURCE", help=SOURCE_HELP)
    _add_filter_options(track, 400)
    track.add_argument("--csv", default=None, metavar="OUT.csv", help="one row a frame")
    track.add_argument("--output", default=None, metavar="OUT.mp4", help="the video with the particles drawn on it")
    track.add_argument("--contact-sheet", default=None, metavar="OUT.png", help="evenly spaced frames of it, as a grid")
    track.add_argument("--json", action="store_true", help="JSON Lines on stdout, one a frame")
    track.add_argument("--force", action="store_true", help="replace files that exist")
    _add_object(track)
    _add_noises(track)
    _add_limits(track, "limits on the file")


def _add_object(command: argparse.ArgumentParser) -> None:
    """What is followed, and what is assumed of it; see ``pfviz_app.video_options``."""
    group = command.add_argument_group("the object in the video")
    where = group.add_mutually_exclusive_group()
    where.add_argument("--box", type=box, default=None, metavar="x,y,w,h", help="the object, in pixels")
    where.add_argument("--polygon", type=polygon, default=None, metavar="x,y;x,y;...", help="its outline instead")
    group.add_argument("--start-frame", type=whole_number(0, 10**9), default=0, metavar="F", help="the first frame")
    group.add_argument(
        "--learn-frame", type=whole_number(0, 10**9), default=None, metavar="F",
        help="the frame that box or polygon are in (default: the start frame); in another one it is looked for",
    )  # fmt: skip
    for option, what in (("--model", "what is measured"), ("--shape", "how it changes")):
        group.add_argument(option, default=None, metavar="NAME", help=f"{what}: see `pfviz models`")
    motion = group.add_mutually_exclusive_group()
    motion.add_argument("--dynamics", default=None, metavar="NAME", help="how it moves: see `pfviz models`")
    motion.add_argument(
        "--learn-dynamics", default=None, metavar="TRUTH.csv",
        help="learn that from positions, one row a frame: columns frame,x,y or frame,cx,cy or frame,x,y,w,h",
    )  # fmt: skip
    group.add_argument(
        "--working-width", type=whole_number(16, 100_000), default=320, metavar="W",
        help="larger frames are measured at about this width (default: 320)",
    )  # fmt: skip
    group.add_argument("--no-restart", action="store_true", help="do not look for an object that is lost")
    group.add_argument(
        "--frame-rate", type=real_number(0.1, 1000.0), default=None, metavar="R", help="of images, per second (30)"
    )


def _add_limits(command: argparse.ArgumentParser, title: str) -> None:
    """What a file may cost; see ``pfviz.vision.limits.Limits``."""
    group = command.add_argument_group(title)
    for option, default, most, what in (
        ("--max-megabytes", 8_000, 10**9, "of each file on disk"),
        ("--max-pixels", 50_000_000, 10**9, "of a frame"),
        ("--max-frames", 1_000_000, 10**9, "after so many the video ends"),
        ("--max-memory", 3_000, 10**9, "megabytes of the process that decodes"),
    ):
        help_ = f"{what} (default: {default})"
        group.add_argument(option, type=whole_number(1, most), default=default, metavar="N", help=help_)
    help_ = "without a frame, before the file is given up (default: 20)"
    group.add_argument("--patience", type=real_number(0.1, 1e6), default=20.0, metavar="SECONDS", help=help_)


def _add_experiment(commands: Any) -> None:
    names = (
        "equal-time, tracking-error, loss-probability, regime-map, noise-robustness, recovery, unbiasedness, real-clips"
    )
    experiment = commands.add_parser("experiment", help="run an experiment: tables, figures and a report")
    experiment.add_argument("name", metavar="NAME", help=names)
    experiment.add_argument("--seeds", type=whole_number(1, 100_000), metavar="N", help="more or fewer than usual")
    experiment.add_argument("--out", metavar="DIR", help="where the results go, and go on (default: results/NAME)")
    where = experiment.add_mutually_exclusive_group()
    where.add_argument("--workers", type=whole_number(1, 1024), metavar="N", help="processes (default: one a core)")
    where.add_argument("--scheduler", metavar="ADDRESS", help="of a Dask cluster to run on: tcp://host:8786")


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line; ``pfviz`` alone is ``pfviz serve``."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    parser = build_parser()
    if not words or (words[0].startswith("-") and words[0] not in ("-h", "--help")):
        words.insert(0, "serve")
    options = parser.parse_args(list(_joined(words)))
    try:
        _COMMANDS[options.command](options)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except KeyboardInterrupt:
        raise SystemExit(0 if options.command == "serve" else 130) from None
    except (ValueError, OSError) as error:
        fail(" ".join(str(error).split()))


def _joined(words: Sequence[str]) -> Iterator[str]:
    """``--box -5,0,20,20`` as ``--box=-5,0,20,20``, and ``--polygon 1,2 3,4`` as ``--polygon=1,2;3,4``.

    A value that begins with a minus is not an option.
    """
    remaining = deque(words)
    while remaining:
        word = remaining.popleft()
        if word == "--box" and remaining:
            word = f"{word}={remaining.popleft()}"
        elif word == "--polygon" and remaining:
            points = [remaining.popleft()]
            while remaining and _PAIR.fullmatch(remaining[0]):
                points.append(remaining.popleft())
            word = f"{word}={';'.join(points)}"
        yield word


def _serve(options: argparse.Namespace) -> None:
    from pfviz_app.server import serve

    serve(options)


def _toy(options: argparse.Namespace) -> None:
    from pfviz_app.commands_toy import toy

    toy(options)


def _track(options: argparse.Namespace) -> None:
    from pfviz_app.commands_track import run_track

    run_track(options)


def _experiment(options: argparse.Namespace) -> None:
    from pfviz_app.commands_experiment import run_experiment

    run_experiment(options)


def _worlds(options: argparse.Namespace) -> None:
    from pfviz_app.listings import list_worlds

    list_worlds(options.json)


def _filters(options: argparse.Namespace) -> None:
    from pfviz_app.listings import list_filters

    list_filters(options.json)


def _models(options: argparse.Namespace) -> None:
    from pfviz_app.listings import list_models

    list_models(options.json)


_COMMANDS: dict[str, Callable[[argparse.Namespace], None]] = {
    "serve": _serve,
    "toy": _toy,
    "track": _track,
    "experiment": _experiment,
    "worlds": _worlds,
    "filters": _filters,
    "models": _models,
}
