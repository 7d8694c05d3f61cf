"""The tracker, frame by frame: where its milliseconds go, and what a frame costs beside other trackers.

The video is the synthetic scene `twin`, as it is (240 x 180) and enlarged to 640 x 480, written to a file and decoded
from it. Real clips are added where the environment variable PFVIZ_CLIPS names a folder with `NAME/video.mp4` and
`NAME/truth.csv` (columns frame, x, y, w, h: the box). With --repeats R everything is run R times over and the
quickest time of each frame counts, for a machine that is busy otherwise.
"""

from __future__ import annotations

import argparse
import csv
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from _timing import machine, print_table

from pfviz import kernels
from pfviz.filters import make_filter
from pfviz.randomness import step_rng
from pfviz.vision import TrackerModel, VideoSource, VideoWriter, draw_track, frames, learn_tracker, open_source, track
from pfviz.vision.blob import BlobDetector
from pfviz.vision.scenes import Scene
from pfviz.vision.video import Box, Image

FILTER = "rb-ss-hs-sir"
SIZES = ((240, 180), (640, 480))
COUNTS = (400, 2000, 10_000)
FRAMES = 120
PARTS: dict[str, tuple[tuple[Any, str], ...]] = {
    "features": ((TrackerModel, "observe"),),
    "proposal": ((BlobDetector, "detect"),),
    "association": ((kernels, "sample_histories"), (kernels, "log_mixture_density")),
    "likelihood": ((TrackerModel, "log_likelihood"),),
}


def enlarged(image: Image, size: tuple[int, int]) -> Image:
    if image.shape[1::-1] == size:
        return image
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_CUBIC), dtype=np.uint8)


def write_scene(folder: Path, size: tuple[int, int]) -> Path:
    path = folder / f"twin-{size[0]}.mp4"
    with Scene(0) as scene, VideoWriter(path, size, scene.frame_rate) as writer:
        for _, image in frames(scene):
            writer.write(enlarged(image, size))
    return path


def start_box(size: tuple[int, int]) -> Box:
    x, y, w, h = (size[0] / 240.0 * value for value in Scene(0).box(0))
    return x, y, w, h


@contextmanager
def timed(owner: Any, name: str, spent: list[float]) -> Iterator[None]:
    """Add the seconds that each call of ``owner.name`` takes to the last of ``spent``."""
    original = getattr(owner, name)

    def call(*arguments: Any, **options: Any) -> Any:
        began = time.perf_counter()
        try:
            return original(*arguments, **options)
        finally:
            spent[-1] += time.perf_counter() - began

    setattr(owner, name, call)
    try:
        yield
    finally:
        setattr(owner, name, original)


def times_of(path: Path, box: Box, n: int, count: int) -> dict[str, list[float]]:
    """Seconds that every part took of each of ``count`` frames, and the whole without drawing, and drawing."""
    spent: dict[str, list[float]] = {name: [0.0] for name in ("decode", *PARTS)}
    whole, drawing = [], []
    with open_source(path) as source, ExitStack() as stack:
        model = learn_tracker(source.read(0), box, frame_rate=source.frame_rate)
        stack.enter_context(timed(source, "read", spent["decode"]))
        for name, calls in PARTS.items():
            for owner, function in calls:
                stack.enter_context(timed(owner, function, spent[name]))
        began = time.perf_counter()
        for item in islice(track(source, model, make_filter(FILTER, n)), count):
            whole.append(time.perf_counter() - began)
            began = time.perf_counter()
            draw_track(item.image, model, item.record, item.estimate)
            drawing.append(time.perf_counter() - began)
            for times in spent.values():
                times.append(0.0)
            began = time.perf_counter()
    return {name: times[: len(whole)] for name, times in spent.items()} | {"whole": whole, "drawing": drawing}


def parts_of(path: Path, box: Box, n: int, count: int, repeats: int) -> dict[str, float]:
    """Milliseconds a frame: the quickest of the repeats, the median over frames."""
    runs = [times_of(path, box, n, count) for _ in range(repeats)]
    ms = {name: 1e3 * float(np.median(np.min([run[name] for run in runs], axis=0))) for name in runs[0]}
    ms["features"] -= ms["proposal"]
    return ms


def show_parts(films: dict[tuple[int, int], Path], repeats: int) -> None:
    names = ("decode", *PARTS)
    rows = []
    for size, path in films.items():
        for n in COUNTS:
            ms = parts_of(path, start_box(size), n, FRAMES if n < 10_000 else FRAMES // 4, repeats)
            rest = ms["whole"] - sum(ms[name] for name in names)
            cells = [f"{ms[name]:.2f}" for name in names] + [f"{rest:.2f}", f"{ms['whole']:.2f}"]
            rate = f"**{1e3 / ms['whole']:.0f}**"
            rows.append([f"{size[0]} x {size[1]}, N = {n}", *cells, rate, f"{ms['drawing']:.2f}"])
    columns = ["milliseconds a frame", *names, "rest", "whole", "frames/s", "drawing, not included"]
    print_table(f"`{FILTER}` on video from a file: where the time goes", columns, rows)


def decode_rate(path: Path) -> float:
    """Frames a second that can be read when nothing else is done."""
    with open_source(path) as source:
        began = time.perf_counter()
        count = sum(1 for _ in frames(source))
        return count / (time.perf_counter() - began)


Locate = Callable[[int, Image], tuple[float, float]]


def pfviz_tracker(image: Image, box: Box, n: int, plain: bool) -> Locate:
    model, filter = learn_tracker(image, box), make_filter(FILTER, n)
    state = {"particles": filter.initial(step_rng(0, 0), model)}

    def locate(t: int, image: Image) -> tuple[float, float]:
        with kernels.use_numpy() if plain else nullcontext():
            record = filter.step(step_rng(0, t), model, state["particles"], model.observe(image))
        state["particles"] = record.posterior
        estimate = model.estimate(record)
        return estimate.x, estimate.y

    return locate


def camshift(image: Image, box: Box) -> Locate:
    x, y, w, h = (round(value) for value in box)
    hsv = cv2.cvtColor(image, cv2.COLOR_BGR2HSV)[y : y + h, x : x + w]
    mask = cv2.inRange(hsv, np.array([0, 60, 32]), np.array([180, 255, 255]))
    histogram = cv2.normalize(cv2.calcHist([hsv], [0], mask, [32], [0, 180]), None, 0, 255, cv2.NORM_MINMAX)
    state = {"window": (x, y, w, h)}
    end = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 10, 1)

    def locate(t: int, image: Image) -> tuple[float, float]:
        hue = cv2.cvtColor(image, cv2.COLOR_BGR2HSV)
        likely = cv2.calcBackProject([hue], [0], histogram, [0, 180], 1)
        (centre, _, _), state["window"] = cv2.CamShift(likely, state["window"], end)
        return centre

    return locate


def opencv_tracker(name: str, image: Image, box: Box) -> Locate:
    tracker = getattr(cv2, name).create()
    tracker.init(image, tuple(round(value) for value in box))

    def locate(t: int, image: Image) -> tuple[float, float]:
        _, (x, y, w, h) = tracker.update(image)
        return x + w / 2, y + h / 2

    return locate


def contestants(image: Image, box: Box) -> dict[str, Locate]:
    """All that are installed; OpenCV's other trackers need networks to be fetched."""
    found: dict[str, Locate] = {}
    for n in (400, 2000):
        found[f"pfviz, N = {n}"] = pfviz_tracker(image, box, n, plain=False)
        found[f"pfviz's NumPy twins, N = {n}"] = pfviz_tracker(image, box, n, plain=True)
    if hasattr(cv2, "CamShift"):
        found["OpenCV CamShift (a box, one guess)"] = camshift(image, box)
    for name in ("TrackerKCF", "TrackerCSRT", "TrackerMIL"):
        if hasattr(cv2, name):
            found[f"OpenCV {name} (a box, one guess)"] = opencv_tracker(name, image, box)
    return found


def contest(size: tuple[int, int], repeats: int) -> tuple[dict[str, float], dict[str, list[float]]]:
    """Of each contestant the seconds a frame, as in ``parts_of``, and its errors in pixels of the scene.

    Every frame is given to one contestant after the other, so that a busy moment favours none.
    """
    scene = Scene(0)
    pictures = [enlarged(image, size) for _, image in islice(frames(scene), FRAMES)]
    times: dict[str, list[list[float]]] = {}
    errors: dict[str, list[float]] = {}
    for _ in range(repeats):
        running = contestants(pictures[0], start_box(size))
        for name in running:
            times.setdefault(name, []).append([])
            errors[name] = []
        for index, image in enumerate(pictures):
            for name, locate in running.items():
                began = time.perf_counter()
                x, y = locate(index + 1, image)
                times[name][-1].append(time.perf_counter() - began)
                shrink, (true_x, true_y, *_) = 240.0 / size[0], scene.truth(index)
                errors[name].append(float(np.hypot(x * shrink - true_x, y * shrink - true_y)))
    return {name: float(np.median(np.min(runs, axis=0))) for name, runs in times.items()}, errors


def show_contest(repeats: int) -> None:
    results = {size: contest(size, repeats) for size in SIZES}
    times, errors = results[SIZES[0]]
    rows = []
    for name in times:
        lost = f"{100 * np.mean(np.array(errors[name]) > 20.0):.0f} %"
        cells = [f"{1e3 * results[size][0][name]:.2f} ({1 / results[size][0][name]:.0f})" for size in SIZES]
        rows.append([name, *cells, f"{np.median(errors[name]):.1f}", lost])
    sizes = [f"{w} x {h}, ms (frames/s)" for w, h in SIZES]
    columns = ["", *sizes, "median error, pixels of 240 x 180", "frames off by over 20"]
    print_table("A frame in memory, located: one seed of a scene with a twin", columns, rows)


def clips() -> Iterator[tuple[str, Path, int, Box]]:
    """Name, video, first frame and box of the clips there are."""
    folder = os.environ.get("PFVIZ_CLIPS")
    for path in sorted(Path(folder).glob("*/video.mp4")) if folder else ():
        with (path.parent / "truth.csv").open(newline="") as stream:
            first = next((row for row in csv.DictReader(stream) if row["w"] and float(row["w"]) > 0), None)
        if first is not None:
            x, y, w, h = (float(first[key]) for key in "xywh")
            yield path.parent.name, path, int(first["frame"]), (x, y, w, h)


def run_over(source: VideoSource, start: int, box: Box, n: int) -> float:
    """Frames a second from the file to the estimates, all waiting included."""
    model = learn_tracker(source.read(start), box, frame_rate=source.frame_rate)
    began = time.perf_counter()
    count = sum(1 for _ in track(source, model, make_filter(FILTER, n), start_frame=start))
    return count / (time.perf_counter() - began)


def show_clips() -> None:
    rows = []
    for name, path, start, box in clips():
        rates = []
        for n in (400, 2000):
            with open_source(path) as source:
                size, rate = source.size, source.frame_rate
                rates.append(f"{run_over(source, start, box, n):.0f}")
        rows.append([name, f"{size[0]} x {size[1]}, {rate:.0f} frames/s", f"{decode_rate(path):.0f}", *rates])
    if rows:
        columns = ["clip", "", "decoding alone, frames/s", "tracking, N = 400", "N = 2000"]
        print_table("Real clips, from the file to the estimates", columns, rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=1, metavar="R", help="of R runs the quickest time of each frame")
    repeats = parser.parse_args().repeats
    kernels.warm_up()
    print(machine())
    with tempfile.TemporaryDirectory() as folder:
        films = {size: write_scene(Path(folder), size) for size in SIZES}
        show_parts(films, repeats)
        rates = ", ".join(f"{decode_rate(path):.0f} at {w} x {h}" for (w, h), path in films.items())
        print(f"\nDecoding alone, in its own process, gives {rates} frames/s.")
    show_contest(repeats)
    show_clips()


if __name__ == "__main__":
    main()
