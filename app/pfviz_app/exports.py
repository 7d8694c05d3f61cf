"""Taking a run away: as a script that does it again, as tables, as figures and as a video.

Everything is read from what was recorded. Numbers are written so that reading them gives the same number again.
"""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pfviz.figures import course_of, plot_courses, plot_frame, plot_step
from pfviz.filters import FILTERS
from pfviz.genealogy import unique_ancestors
from pfviz.particles import FloatArray
from pfviz.record import Stage, StepRecord
from pfviz.vision import Limits, TrackerModel, VideoWriter, draw_track
from pfviz.worlds import WORLDS, get_world
from pfviz_app.differences import differences
from pfviz_app.films import Start, ToyFilm, VideoFilm
from pfviz_app.room import Room
from pfviz_app.settings import CONTROLS, RUNNING, Settings
from pfviz_app.share import changes
from pfviz_app.stage.seen import Seen
from pfviz_app.start_box import USUAL, Assumptions

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TRACKER_COMPONENTS = "x", "y", "rotation", "log_scale"
_ANCESTORS_BACK = 10
BUILT_IN = frozenset(WORLDS) | frozenset(FILTERS)
"""Names that a script can count on: what ``pfviz.show`` adds is added later."""
_NAMES = {
    "itertools": ("islice",),
    "pfviz": ("make_filter",),
    "pfviz.dynamics": ("learn_dynamics", "read_states"),
    "pfviz.kernels": ("use_numpy",),
    "pfviz.vision": (
        "NOT_YET_FOUND",
        "Limits",
        "Restarting",
        "TrackerOptions",
        "learn_tracker",
        "open_source",
        "suggested_box",
        "track",
    ),
}
"""What the script of a video may use, by module."""


def toy_script(log: Sequence[Settings], held: Mapping[int, FloatArray] | None = None, plain: bool = False) -> str:
    """A Python script that runs the toy's film again and prints what was recorded, to the last digit.

    It uses public names only. Where settings were changed during the run it repeats those of the first step, and
    says in comments what was changed.

    Args:
        log: the settings of the steps at t = 1, 2, ...
        held: by time, where the target was put.
        plain: whether the run was computed without the compiled loops, whose last digits may differ.

    Raises:
        ValueError: if the log is empty.
    """
    first = _first(log, "toy")
    names = ",".join(_toy_components(get_world(first.world).model.dynamics.dimension))
    places = "".join(f"{t}: np.array({place.tolist()!r}), " for t, place in sorted((held or {}).items()))
    held_text = f", held={{{places[:-2]}}}" if held else ""
    lines = [
        *_heading(f"the world {first.world!r}", log, "tracker_particles", (first.world, first.filter)),
        *(["import numpy as np", ""] if held else []),
        "from pfviz import get_world, make_filter, run",
        *(["from pfviz.kernels import use_numpy"] if plain else []),
        "",
        f"world = get_world({first.world!r})",
        f"model = world.model.with_noise({_noises(first)})",
        f"film = world.record(seed={first.seed}, steps={len(log)}{held_text})",
        f"filter_ = make_filter({first.filter!r}, n_particles={first.toy_particles})",
        "",
        f'print("t,{names},effective_sample_size,log_evidence")',
    ]
    loop = [
        f"records = run(filter_, model, film.observations, seed={first.seed})",
        "for t, record in enumerate(records, start=1):",
        '    print(t, *record.estimate, record.effective_sample_size, record.log_evidence, sep=",")',
    ]
    return "\n".join([*lines, *_plainly(loop, plain)]) + "\n"


def tracker_script(
    log: Sequence[Settings],
    source: str,
    start: Start | None = None,
    start_frame: int | None = None,
    plain: bool = False,
    *,
    assumed: Assumptions = USUAL,
    limits: Limits | None = None,
    frame_rate: float | None = None,
) -> str:
    """A Python script that tracks the video again and prints what was recorded, to the last digit.

    Args:
        log: the settings of the steps at t = 1, 2, ...
        source: as ``open_source`` takes it: a file, ``camera:N`` or ``scene:NAME``.
        start: what is followed; what the source suggests by default.
        start_frame: the frame of t = 1; by default that of ``start``, or else the first.
        plain: whether the run was computed without the compiled loops, whose last digits may differ.
        assumed: of what is followed.
        limits: of what the source may cost.
        frame_rate: of images, where it was given.

    Raises:
        ValueError: if the log is empty.
    """
    first = _first(log, "video")
    start_frame = (start.frame if start else 0) if start_frame is None else start_frame
    frame = start.frame if start else start_frame
    body = [
        f"image = source.read({frame})",
        f"model = learn_tracker(image, {_outline(start, frame)}, frame_rate=source.frame_rate{_assumed(assumed)})",
        *(["model = model.given(NOT_YET_FOUND)"] if frame != start_frame else []),
        f"model = model.with_noise({_noises(first)})",
        f"filter_ = make_filter({first.filter!r}, n_particles={first.tracker_particles})",
        f"filter_ = Restarting(filter_{'' if assumed.restart else ', share=0.0'})",
        f"tracked = track(source, model, filter_, seed={first.seed}, start_frame={start_frame})",
        'print("t,x,y,rotation,scale,effective_sample_size,log_evidence")',
        f"for t, item in enumerate(islice(tracked, {len(log)}), start=1):",
        "    e, record = item.estimate, item.record",
        "    numbers = e.x, e.y, e.rotation, e.scale, record.effective_sample_size, record.log_evidence",
        '    print(t, *numbers, sep=",")',
    ]
    block = [f"with open_source({_opening(source, limits, frame_rate)}) as source:"]
    block += ["    " + line for line in _plainly(body, plain)]
    heading = _heading(f"the video {source!r}", log, "toy_particles", (first.filter,))
    return "\n".join([*heading, *_imports("\n".join(block)), "", *block]) + "\n"


def _imports(text: str) -> Iterator[str]:
    """The import lines of what ``text`` uses."""
    for module, names in _NAMES.items():
        used = [name for name in names if re.search(rf"\b{name}\b", text)]
        if used:
            yield f"from {module} import {', '.join(used)}"
        if module == "itertools":
            yield ""


def _opening(source: str, limits: Limits | None, frame_rate: float | None) -> str:
    """The arguments of ``open_source``; only what is not usual."""
    changed = [f"{name}={value!r}" for name, value in differences(limits or Limits(), Limits()).items()]
    found = [repr(source), *([f"limits=Limits({', '.join(changed)})"] if changed else [])]
    return ", ".join(found if frame_rate is None else [*found, f"frame_rate={frame_rate!r}"])


def _first(log: Sequence[Settings], room: str) -> Settings:
    if not log:
        raise ValueError(f"nothing has been run in the {room} yet: take a step first")
    return log[0]


def _heading(where: str, log: Sequence[Settings], elsewhere: str, names: Sequence[str]) -> list[str]:
    """The docstring, and comments on what the script cannot repeat.

    ``elsewhere`` is the setting of the other room's particles; ``names`` are those that the script looks up.
    """
    title = FILTERS[log[0].filter].title
    lines = [f'"""{title} on {where}, {len(log)} steps: what pfviz showed, done again."""', ""]
    for name in names:
        if name not in BUILT_IN:
            lines += [
                f"# {name!r} is not part of pfviz: define it here and put it into pfviz.WORLDS or pfviz.FILTERS.",
                "",
            ]
    changed = list(changes_in_words(log, elsewhere))
    if changed:
        lines += ["# Settings were changed during the run that was shown. This script keeps those of the first step."]
        lines += [f"#   from step {t}: {text}" for t, text in changed] + [""]
    return lines


def changes_in_words(log: Sequence[Settings], elsewhere: str) -> Iterator[tuple[int, str]]:
    """What was changed and from which step on, in words; ``elsewhere`` is a setting that does not matter here."""
    segments = changes(log)
    for (_, before), (t, after) in pairwise(segments):
        for field, new in differences(after, before, RUNNING).items():
            if field != elsewhere:
                old = getattr(before, field)
                yield t, f"{CONTROLS[field].label if field in CONTROLS else field} {old} -> {new}"


def _noises(settings: Settings) -> str:
    return ", ".join(f"{name}={factor!r}" for name, factor in settings.noises.items())


def _outline(start: Start | None, frame: int) -> str:
    """The argument of ``learn_tracker`` that says what is followed."""
    if start is None:
        return f"suggested_box(source, {frame})"
    if start.box is None:
        return f"polygon={[tuple(float(v) for v in corner) for corner in start.outline]!r}"
    return repr(tuple(float(value) for value in start.box))


def _assumed(assumed: Assumptions) -> str:
    """The arguments of ``learn_tracker`` for what is not assumed everywhere."""
    unusual = differences(assumed, USUAL, ("model", "shape", "dynamics"))
    found = [f", {name}={value!r}" for name, value in unusual.items()]
    if assumed.learnt_from is not None:
        found.append(f", dynamics=learn_dynamics(read_states({assumed.learnt_from!r}))")
    if assumed.working_width != USUAL.working_width:
        found.append(f", options=TrackerOptions(working_width={assumed.working_width})")
    return "".join(found)


def _plainly(lines: Sequence[str], plain: bool) -> list[str]:
    """The lines, inside a block without compiled loops where the run was without them."""
    return ["with use_numpy():", *("    " + line for line in lines)] if plain else list(lines)


def run_json(
    log: Sequence[Settings],
    toy: Room[ToyFilm],
    tracker: Room[VideoFilm],
    held: Mapping[int, FloatArray] | None = None,
) -> str:
    """Settings and summary of a run as JSON; what is not known is null."""
    segments = changes(log)
    content = {
        "settings": asdict(log[-1]) if log else None,
        "changes": [{"from_step": t, **_running(settings)} for t, settings in segments],
        "held": {str(t): place.tolist() for t, place in sorted((held or {}).items())},
        "toy": _summary(toy),
        "video": _summary(tracker),
    }
    return json.dumps(content, indent=2, allow_nan=False) + "\n"


def _running(settings: Settings) -> dict[str, Any]:
    return {field: getattr(settings, field) for field in RUNNING}


def _summary(room: Room[Any]) -> dict[str, Any]:
    trace = room.trace
    if not len(trace):
        return {"steps": 0}
    outcomes = [room.outcome(t) for t in range(trace.first, trace.last + 1)]
    errors = np.array([outcome.error for outcome in outcomes])
    known = bool(np.isfinite(errors).any())
    return {
        "steps": trace.last,
        "first_recorded": trace.first,
        "filter": outcomes[-1].filter_name,
        "particles": len(trace.particles),
        "estimate": [_finite(value) for value in trace[trace.last].estimate],
        "mean_effective_sample_size": float(room.effective_sample_sizes.mean()),
        "rms_error": float(np.sqrt(np.nanmean(errors**2))) if known else None,
        "log_evidence": _finite(outcomes[-1].log_evidence),
        "exact_log_evidence": _finite(_exact_evidence(room, trace.last)),
        "mean_milliseconds": float(np.mean([outcome.milliseconds for outcome in outcomes])),
        "conditions": {name: sum(record.condition == name for record in trace) for name in ("missing", "degenerate")},
    }


def _exact_evidence(room: Room[Any], last: int) -> float:
    if room.exact is None:
        return math.nan
    return float(sum(room.exact.log_evidence(t) for t in range(1, last + 1)))


def _finite(value: float | None) -> float | None:
    """JSON has no NaN and no infinity."""
    return float(value) if value is not None and math.isfinite(value) else None


def trace_csv(room: Room[Any]) -> Iterator[str]:
    """The lines of a table of every weighed particle of every step recorded, so that weights can be worked out again.

    Columns: the time; the particle; the indices of its histories among the particles that the step began with (several
    or none where innovations were weighed before they were joined, as in HS-SIR; of equal particles the one that was
    drawn, where a receipt names the first); the components of its innovation; its
    weight before; one ``log_factor_...`` column for each factor that was multiplied in; and its weight after, which is
    ``weight_before * exp(sum of log factors)``, divided by the sum of these over the step. In a step without an
    observation there are no factors. Empty fields: not known, or no such factor in this step.
    """
    names = _components(room)
    factors = sorted({name for record in room.trace for name in _weighed(record)[0].log_factors})
    header = [
        "t",
        "particle",
        "histories",
        *names,
        "weight_before",
        *(f"log_factor_{name}" for name in factors),
        "weight",
    ]
    yield _row(header)
    for t, record in enumerate(room.trace, start=room.trace.first):
        stage, before = _weighed(record)
        count, innovation = len(stage.particles), stage.particles.innovation
        unknown = [""] * count
        columns = [
            [str(t)] * count,
            map(str, range(count)),
            (" ".join(map(str, indices)) for indices in _histories(record, count)),
            *(_numbers(column) for column in innovation.T),
            *[unknown] * (len(names) - innovation.shape[1]),
            _numbers(before),
            *(_numbers(stage.log_factors[name]) if name in stage.log_factors else unknown for name in factors),
            _numbers(stage.particles.weights),
        ]
        for row in zip(*columns, strict=True):
            yield ",".join(row) + "\n"


def _numbers(values: FloatArray) -> Iterator[str]:
    """Written so that reading them gives them back."""
    return map(repr, values.tolist())


def _weighed(record: StepRecord) -> tuple[Stage, FloatArray]:
    """The stage that weighed (the last one, where none did), and the weights before it."""
    found = [i for i, stage in enumerate(record.stages) if stage.kind == "weight"]
    if not found:
        return record.stages[-1], record.stages[-1].particles.weights
    earlier = record.stages[found[-1] - 1].particles if found[-1] else record.previous
    return record.stages[found[-1]], earlier.weights


def _histories(record: StepRecord, count: int) -> list[list[int]]:
    """For each weighed particle, the histories that it was joined to."""
    joined: list[list[int]] = [[] for _ in range(count)]
    joins = Seen(record).joins()
    if joins is not None:
        for history, weighed in zip(joins[0].tolist(), joins[2].tolist(), strict=True):
            if history >= 0:
                joined[weighed].append(history)
    return joined


def _components(room: Room[Any]) -> Sequence[str]:
    """What the components of an innovation are called."""
    if isinstance(room.film, VideoFilm):
        return TRACKER_COMPONENTS
    return _toy_components(room.trace.initial.dimension)


def _toy_components(dimension: int) -> list[str]:
    return [f"x{i + 1}" for i in range(dimension)]


def summary_csv(room: Room[Any]) -> Iterator[str]:
    """The lines of a table of one row a step: estimate, truth, exact posterior, ESS, evidence, cost, ancestors.

    ``ancestors_10`` is how many different ancestors the particles have ten steps earlier (or at the oldest time that is
    recorded). On the video, estimate and truth are ``x, y, rotation, log_scale``, the estimate that of the heaviest
    mode. Empty fields are not known.
    """
    names = _components(room)
    yield _row(
        [
            "t",
            "filter",
            "particles",
            *names,
            *(f"true_{name}" for name in names),
            *(f"exact_{name}" for name in names),
            "error",
            "effective_sample_size",
            "log_evidence",
            "exact_log_evidence",
            "likelihood_evaluations",
            "transition_evaluations",
            f"ancestors_{_ANCESTORS_BACK}",
            "condition",
            "milliseconds",
        ]
    )
    for t, record in enumerate(room.trace, start=room.trace.first):
        yield _row(_summary_row(room, t, record, len(names)))


def _summary_row(room: Room[Any], t: int, record: StepRecord, dimension: int) -> list[Any]:
    outcome, exact = room.outcome(t), room.exact
    marginal = exact.marginal(t) if exact is not None else None
    unknown = [None] * dimension
    truth = room.film.truth(t)
    if isinstance(outcome.model, TrackerModel):
        estimate: Sequence[Any] = outcome.model.estimate(record).state.tolist()
        truth = None if truth is None else truth.state
    else:
        estimate = record.estimate.tolist()
    return [
        t,
        outcome.filter_name,
        len(record.posterior),
        *estimate,
        *(unknown if truth is None else truth.tolist()),
        *(unknown if marginal is None else marginal.mean.tolist()),
        outcome.error,
        record.effective_sample_size,
        record.log_evidence,
        None if exact is None else exact.log_evidence(t),
        record.likelihood_evaluations,
        record.transition_evaluations,
        unique_ancestors(room.trace, t, _ANCESTORS_BACK),
        record.condition or "",
        outcome.milliseconds,
    ]


def _row(values: Sequence[Any]) -> str:
    """One line of CSV; a float is written so that reading it gives it back, NaN and None as nothing."""
    stream = io.StringIO()
    plain = ["" if v is None or (isinstance(v, float) and math.isnan(v)) else v for v in values]
    csv.writer(stream, lineterminator="\n").writerow(
        [repr(float(v)) if isinstance(v, (float, np.floating)) else v for v in plain]
    )
    return stream.getvalue()


def write_video(
    room: Room[VideoFilm], path: str | Path, progress: Callable[[float], None] | None = None, likely: int = 12
) -> int:
    """Write the frames recorded of the tracker with its contours drawn in; how many there were.

    Args:
        room: of the video.
        path: of the file, which appears when it is complete.
        progress: told the part done after every frame.
        likely: how many contours of likely particles are drawn.

    Raises:
        VideoError: if it cannot be written.
        ValueError: if nothing is recorded.
    """
    trace = room.trace
    if not len(trace):
        raise ValueError("nothing has been tracked yet: take a step first")
    source = room.film.source
    with VideoWriter(path, source.size, source.frame_rate) as writer:
        for done, (t, record) in enumerate(enumerate(trace, start=trace.first), start=1):
            model = room.outcome(t).model
            assert isinstance(model, TrackerModel)
            writer.write(draw_track(room.film.image(t), model, record, model.estimate(record), likely))
            if progress is not None:
                progress(done / len(trace))
    return len(trace)


def toy_figure(room: Room[ToyFilm], t: int, truth: bool = True, exact: bool = True) -> Figure:
    """The step at time ``t`` of the toy, after Figures 1 and 2 of the sources; see ``pfviz.figures.plot_step``."""
    outcome, film = room.outcome(t), room.film
    return plot_step(
        room.trace[t],
        outcome.model,
        truth=film.truth(t) if truth else None,
        exact=room.exact.marginal(t) if exact and room.exact is not None else None,
        title=f"{FILTERS[outcome.filter_name].title}, t = {t}",
    )


def tracker_figure(room: Room[VideoFilm], t: int, truth: bool = True) -> Figure:
    """The step at time ``t`` of the tracker, after Figure 3 of the sources; see ``pfviz.figures.plot_frame``."""
    outcome, film = room.outcome(t), room.film
    assert isinstance(outcome.model, TrackerModel)
    title = f"{FILTERS[outcome.filter_name].title}, frame {film.frame_index(t)}"
    return plot_frame(film.image(t), outcome.model, room.trace[t], truth=film.truth(t) if truth else None, title=title)


def courses_figure(rooms: Mapping[str, Room[Any]], t: int, title: str = "") -> Figure:
    """Runs over time up to ``t``, by the names that they have in the legend; see ``pfviz.figures.plot_courses``.

    Raises:
        ValueError: if nothing is recorded.
    """
    courses = []
    for label, room in rooms.items():
        times = range(room.trace.first, t + 1)
        errors = [room.outcome(time).error for time in times]
        exact = [] if room.exact is None else [room.exact.log_evidence(time) for time in times]
        courses.append(
            course_of(
                room.trace,
                label,
                errors if np.isfinite(errors).any() else None,
                exact if exact and np.isfinite(exact).all() else None,
                last=t,
            )
        )
    return plot_courses(courses, title=title)
