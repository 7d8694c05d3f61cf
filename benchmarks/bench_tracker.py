"""The tracker, frame by frame: where its milliseconds go, and what a frame costs beside other trackers.

The video is the synthetic scene `twin`, as it is (240 x 180) and enlarged to 640 x 480, written to a file and decoded
from it. Real clips are added where the environment variable PFVIZ_CLIPS names a folder with `NAME/video.mp4` and
`NAME/truth.csv` (columns frame, x, y, w, h: the box). With --cpu the first table counts the processor time of this
process instead of the time that passes, for a machine that is busy otherwise.
"""

from __future__ import annotations

import argparse
import csv
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import cv2
import numpy as np
from _timing import interleaved, machine, print_table

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
ROUNDS = 120
Clock = Callable[[], float]
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
def timed(owner: Any, name: str, spent: list[float], clock: Clock) -> Iterator[None]:
    """Add the seconds that each call of ``owner.name`` takes to the last of ``spent``."""
    original = getattr(owner, name)

    def call(*arguments: Any, **options: Any) -> Any:
        began = clock()
        try:
            return original(*arguments, **options)
        finally:
            spent[-1] += clock() - began

    setattr(owner, name, call)
    try:
        yield
    finally:
        setattr(owner, name, original)


def parts_of(path: Path, box: Box, n: int, rounds: int, clock: Clock) -> dict[str, float]:
    """Median milliseconds a frame of every part, of the whole without drawing, and of drawing."""
    spent: dict[str, list[float]] = {name: [0.0] for name in PARTS}
    totals, waits, drawings = [], [], []
    with open_source(path) as source, ExitStack() as stack:
        model = learn_tracker(source.read(0), box, frame_rate=source.frame_rate)
        stack.enter_context(timed(source, "read", waits, clock))
        for name, calls in PARTS.items():
            for owner, function in calls:
                stack.enter_context(timed(owner, function, spent[name], clock))
        waits.append(0.0)
        began = clock()
        for item in track(source, model, make_filter(FILTER, n)):
            totals.append(clock() - began)
            began = clock()
            draw_track(item.image, model, item.record, item.estimate)
            drawings.append(clock() - began)
            began = clock()
            for times in (*spent.values(), waits):
                times.append(0.0)
            if len(totals) == rounds:
                break
    ms = {name: 1e3 * median(times[:-1]) for name, times in {"decode": waits, **spent}.items()}
    ms["features"] -= ms["proposal"]
    ms["whole"] = 1e3 * median(totals)
    ms["drawing"] = 1e3 * median(drawings)
    return ms


def show_parts(films: dict[tuple[int, int], Path], clock: Clock) -> None:
    names = ("decode", *PARTS)
    rows = []
    for size, path in films.items():
        for n in COUNTS:
            ms = parts_of(path, start_box(size), n, ROUNDS if n < 10_000 else 30, clock)
            rest = ms["whole"] - sum(ms[name] for name in names)
            cells = [f"{ms[name]:.2f}" for name in names] + [f"{rest:.2f}", f"{ms['whole']:.2f}"]
            rate = f"**{1e3 / ms['whole']:.0f}**"
            rows.append([f"{size[0]} x {size[1]}, N = {n}", *cells, rate, f"{ms['drawing']:.2f}"])
    columns = ["milliseconds a frame", *names, "rest", "whole", "frames/s", "drawing, not included"]
    kind = "time" if clock is time.perf_counter else "processor time"
    print_table(f"`{FILTER}` on video from a file: where the {kind} goes (medians)", columns, rows)


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


def show_contest() -> None:
    scene = Scene(0)
    times: dict[tuple[int, int], dict[str, float]] = {}
    errors: dict[str, list[float]] = {}
    for size in SIZES:
        pictures = [enlarged(image, size) for _, image in frames(scene)][: ROUNDS + 1]

        def step(name: str, locate: Locate, size: tuple[int, int], t: int, image: Image) -> None:
            x, y = (value * 240.0 / size[0] for value in locate(t, image))
            if size == SIZES[0]:
                errors.setdefault(name, []).append(
                    float(np.hypot(x - scene.truth(t - 1)[0], y - scene.truth(t - 1)[1]))
                )

        running = {
            name: partial(step, name, run, size) for name, run in contestants(pictures[0], start_box(size)).items()
        }
        data = [(t, image) for t, image in enumerate(pictures, start=1)]
        times[size] = interleaved(running, data, ROUNDS, seconds=60.0)
    rows = []
    for name in errors:
        lost = f"{100 * np.mean(np.array(errors[name]) > 20.0):.0f} %"
        cells = [f"{1e3 * times[size][name]:.2f} ({1 / times[size][name]:.0f})" for size in SIZES]
        rows.append([name, *cells, f"{median(errors[name]):.1f}", lost])
    sizes = [f"{w} x {h}, ms (frames/s)" for w, h in SIZES]
    columns = ["", *sizes, "median error, pixels of 240 x 180", "frames off by over 20"]
    print_table("A frame in memory, located: median time, one seed of a scene with a twin", columns, rows)


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
    parser.add_argument("--cpu", action="store_true", help="processor time instead of the time that passes")
    clock = time.process_time if parser.parse_args().cpu else time.perf_counter
    kernels.warm_up()
    print(machine())
    with tempfile.TemporaryDirectory() as folder:
        films = {size: write_scene(Path(folder), size) for size in SIZES}
        show_parts(films, clock)
        rates = ", ".join(f"{decode_rate(path):.0f} at {w} x {h}" for (w, h), path in films.items())
        print(f"\nDecoding alone, in its own process, gives {rates} frames/s.")
    show_contest()
    show_clips()


if __name__ == "__main__":
    main()
