"""The figures show what was recorded: read back from what was drawn, and from the bytes of the files."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from matplotlib.collections import LineCollection, PathCollection, PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch
from stand_ins import DiscVideo, disc_frame, disc_model

from pfviz.exact import Gaussian
from pfviz.figures import PANELS, course_of, plot_courses, plot_frame, plot_line, plot_plane, plot_step, render, style
from pfviz.figures.reading import innovation_strengths, made_pairs, outcome, possible_pairs, proposal_stage
from pfviz.filters import FILTERS, make_filter
from pfviz.particles import ParticleSet
from pfviz.randomness import step_rng
from pfviz.record import StepRecord, Trace
from pfviz.running import run
from pfviz.vision import track
from pfviz.vision.drawing import likely_states
from pfviz.worlds import Detector, ToyModel, get_world

ROOT = Path(__file__).resolve().parents[1]
every_filter = pytest.mark.parametrize("name", FILTERS)
every_world = pytest.mark.parametrize("world", ["figure-1", "two-modes", "plane"])


@lru_cache(maxsize=64)
def step(name: str, world: str, count: int = 12, t: int = 4) -> StepRecord:
    records = run(make_filter(name, count), get_world(world).model, get_world(world).record(0, t).observations)
    return list(records)[-1]


def drawn(figure: Figure, kind: type) -> list:
    return [artist for axes in figure.axes for artist in axes.get_children() if isinstance(artist, kind)]


def points_of(figure: Figure, colour: str) -> list[np.ndarray]:
    """The offsets of every scatter whose darkest point has this colour."""
    found = []
    for scatter in drawn(figure, PathCollection):
        colours = np.asarray(scatter.get_facecolors())[:, :3]
        if (np.abs(colours - to_rgb(colour)).sum(axis=1) < 1e-6).any():
            found.append(np.asarray(scatter.get_offsets()))
    return found


@every_world
@every_filter
def test_new_particles_go_back_to_what_was_proposed_and_to_their_histories(name, world):
    record = step(name, world)
    new, proposed = outcome(record), proposal_stage(record).particles.innovation
    if name != "ls-n-ips":  # its particles have moved on from where they were drawn
        np.testing.assert_array_equal(new.particles.innovation, proposed[new.proposed])
    joined = new.histories >= 0
    if record.previous.order > 1:
        histories = record.previous.innovation[new.histories[joined]]
        np.testing.assert_array_equal(new.particles.states[joined, 1], histories)
    made = made_pairs(record)
    assert Counter(zip(made.sources, made.targets, strict=True)) == Counter(
        zip(new.histories[joined], new.proposed[joined], strict=True)
    )
    assert new.strengths.max() == 1.0


@pytest.mark.parametrize("name", ["hs-sir", "rb-hs-sir", "rb-ss-hs-sir", "ls-hs-sir", "innovation-sir"])
def test_possible_joins_have_their_probabilities(name):
    """Brute force: w_l p(u_i | x_l) for all pairs, normalised for the innovation, or for the history that chose."""
    record, model = step(name, "figure-1"), get_world("figure-1").model
    pairs, proposed = possible_pairs(record, at_least=0.0), proposal_stage(record).particles.innovation
    assert pairs is not None
    given = np.zeros((len(record.previous), len(proposed)))
    states = record.previous.states
    density = np.array([np.exp(model.dynamics.log_transition(np.tile(u, (12, 1)), states, (0,))) for u in proposed]).T
    if name == "innovation-sir":
        log_worth = model.log_likelihood(proposed, record.observation)
        worth = np.exp(log_worth - model.proposal(record.observation).log_density(proposed))
        expected = density * worth / (density * worth).sum(axis=1, keepdims=True)
        kept = record.stages[0].histories
        assert kept is not None
        expected *= np.bincount(kept, minlength=12)[:, None]
    else:
        expected = record.previous.weights[:, None] * density
        expected = expected / expected.sum(axis=0) * np.bincount(outcome(record).proposed, minlength=12)
    np.add.at(given, (pairs.sources, pairs.targets), pairs.strengths)
    np.testing.assert_allclose(given, expected, atol=1e-9)
    likely = possible_pairs(record, at_least=0.2)
    assert likely is not None and 0 < len(likely.sources) < len(pairs.sources) and likely.strengths.min() >= 0.2


@pytest.mark.parametrize("name", ["condensation", "basic-sir", "unscented"])
def test_there_is_no_choice_where_joins_are_made_by_index(name):
    assert possible_pairs(step(name, "figure-1")) is None


def test_arbitrary_joins_are_as_strong_as_they_are_plausible():
    record, model = step("basic-sir", "figure-1"), get_world("figure-1").model
    made, proposed = made_pairs(record), proposal_stage(record).particles.innovation
    states = record.previous.states[made.sources]
    log_density = model.dynamics.log_transition(proposed[made.targets], states, (0,))
    peak = -0.5 * np.log(2 * np.pi * model.dynamics.noise_covariance[0, 0])
    np.testing.assert_allclose(made.strengths, np.exp(log_density - peak), rtol=1e-9)


def test_innovations_weighed_alone_are_shown_by_weight():
    record = step("hs-sir", "figure-1")
    weighed = record.stage("weight")
    assert weighed is not None
    np.testing.assert_allclose(
        innovation_strengths(record), weighed.particles.weights / weighed.particles.weights.max()
    )
    assert (innovation_strengths(step("rb-hs-sir", "figure-1")) == 1.0).all()


@every_world
@every_filter
def test_every_step_can_be_drawn(name, world):
    record, model = step(name, world), get_world(world).model
    figure = plot_step(record, model, truth=np.zeros(model.dynamics.dimension), title="a step")
    new, colours = outcome(record), (style.HISTORY, style.PROPOSAL, style.POSTERIOR)
    for colour in colours:
        assert points_of(figure, colour) or colour == style.PROPOSAL
    across = [0] if model.dynamics.dimension == 1 else [0, 1]
    shown = np.sort(points_of(figure, style.POSTERIOR)[-1][:, across], axis=0)
    np.testing.assert_allclose(shown, np.sort(new.particles.innovation, axis=0))
    joins = [c for c in drawn(figure, LineCollection) if len(c.get_segments())]
    assert len(drawn(figure, FancyArrowPatch)) + sum(len(c.get_segments()) for c in joins) >= 12


@every_world
def test_steps_without_observation_or_likelihood_can_be_drawn(world):
    toy = get_world(world)
    particles = ParticleSet.uniform(toy.model.sample_prior(np.random.default_rng(0), 12))
    nothing = np.full_like(toy.record(0, 1).observations[0], np.nan)
    missing = make_filter("rb-hs-sir", 12).step(step_rng(0, 1), toy.model, particles, nothing)
    far = np.full_like(toy.record(0, 1).observations[0], 1e200)
    degenerate = replace(missing, observation=far, condition="degenerate")
    assert missing.condition == "missing"
    figure = plot_step(missing, toy.model)
    assert any("nothing was" in text.get_text() for axes in figure.axes for text in axes.texts)
    with np.errstate(over="ignore", invalid="ignore"):
        assert plot_step(degenerate if world != "two-modes" else missing, toy.model).axes


@every_world
def test_a_filter_of_ones_own_may_record_little(world):
    toy = get_world(world)
    record = step("condensation", world)
    bare = replace(record, stages=(replace(record.stages[-1], histories=None, ancestors=None),))
    figure = plot_step(bare, toy.model)
    shown = points_of(figure, style.POSTERIOR)[-1]
    assert len(shown) == 12 and (outcome(bare).histories == -1).all()
    assert not len(made_pairs(bare).sources)
    half = replace(record, stages=(*record.stages[:-1], replace(record.stages[-1], ancestors=None)))
    assert outcome(half).proposed.tolist() == list(range(12))


def test_weights_are_shown_by_colour_and_size():
    record = step("rb-hs-sir", "figure-1")
    figure = plot_line(record, get_world("figure-1").model)
    scatter = [
        s for s in drawn(figure, PathCollection) if np.allclose(s.get_facecolors()[-1][:3], to_rgb(style.POSTERIOR))
    ][-1]
    order = np.argsort(outcome(record).strengths, kind="stable")
    np.testing.assert_allclose(np.asarray(scatter.get_offsets())[:, 0], outcome(record).particles.innovation[order, 0])
    luminance = np.asarray(scatter.get_facecolors())[:, :3] @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(luminance) <= 1e-12).all() and (np.diff(scatter.get_sizes()) >= -1e-12).all()
    assert luminance[0] - luminance[-1] > 0.2


@pytest.mark.parametrize("world", ["figure-1", "plane"])
def test_of_many_particles_the_heaviest_are_drawn(world):
    record = step("basic-sir", world, 2000, 2)
    figure = plot_step(record, get_world(world).model)
    shown = points_of(figure, style.POSTERIOR)[-1]
    across = slice(0, record.posterior.dimension)
    new = outcome(record)
    heaviest = new.particles.innovation[np.argsort(-new.strengths)[:200]]
    assert 400 < len(shown) <= 800
    assert set(map(tuple, heaviest)) <= set(map(tuple, shown[:, across]))


def test_curves_are_the_densities():
    world = get_world("figure-1")
    record, exact = step("rb-hs-sir", "figure-1"), Gaussian(np.array([0.3]), np.array([[0.2]]))
    axes = plot_line(record, world.model, np.array([0.1]), exact).axes[0]
    curves = {line.get_color(): line.get_xydata() for line in axes.get_lines() if len(line.get_xdata()) > 100}
    grid = curves[style.PROPOSAL][:, :1]
    expected = {
        style.PROPOSAL: world.model.proposal(record.observation).log_density(grid),
        style.LIKELIHOOD: world.model.log_likelihood(grid, record.observation),
        style.EXACT: exact.log_density(grid),
    }
    for colour, log_density in expected.items():
        density = np.exp(log_density - log_density.max())
        slope, base = np.polyfit(density, curves[colour][:, 1], 1)
        np.testing.assert_allclose(base + slope * density, curves[colour][:, 1], atol=1e-9)
        assert slope > 0.3
    ticks = {line.get_color(): line.get_xdata()[0] for line in axes.get_lines() if len(set(line.get_xdata())) == 1}
    assert ticks[style.TRUTH] == pytest.approx(0.1)
    assert ticks[style.POSTERIOR] == pytest.approx(record.estimate[0])


def test_an_extent_is_kept_and_what_lies_outside_is_drawn_at_the_edge():
    record = step("rb-hs-sir", "figure-1")
    figure = plot_line(record, get_world("figure-1").model, extent=0.2)
    assert figure.axes[0].get_xlim() == (-0.2, 0.2)
    assert max(np.abs(s.get_offsets()[:, 0]).max() for s in drawn(figure, PathCollection)) == pytest.approx(0.2)


def test_the_plane_shows_the_exact_ellipse_truth_and_estimate():
    record = step("rb-hs-sir", "plane")
    exact = Gaussian(np.array([1.0, 2.0]), np.array([[0.5, 0.2], [0.2, 0.4]]))
    axes = plot_plane(record, get_world("plane").model, np.array([0.5, 0.6]), exact).axes[3]
    lines = [line.get_xydata() for line in axes.get_lines()]
    ellipse = next(line for line in lines if len(line) > 50)
    whitened = np.linalg.solve(np.linalg.cholesky(exact.covariance), (ellipse - exact.mean).T)
    np.testing.assert_allclose((whitened**2).sum(axis=0), 4.0)
    singles = [line[0].tolist() for line in lines if len(line) == 1]
    assert [0.5, 0.6] in singles and any(np.allclose(single, record.estimate) for single in singles)


def test_components_that_were_not_proposed_are_drawn_where_they_were_completed():
    plane = get_world("plane").model

    class OneAxis:
        def __call__(self, observation: np.ndarray):
            return replace(Detector(2.0, np.zeros((1, 1)), np.ones(1))(observation[:1, :1]), components=(0,))

        def with_width(self, factor: float) -> OneAxis:
            return self

    model = ToyModel(plane.dynamics, plane.observed, OneAxis(), plane.prior)
    observations = get_world("plane").record(0, 2).observations
    for name in ("rb-ss-hs-sir", "basic-sir", "hs-sir", "innovation-sir"):
        record = list(run(make_filter(name, 60), model, observations))[-1]
        assert proposal_stage(record).particles.dimension == 1
        figure = plot_step(record, model)
        orange = points_of(figure, style.PROPOSAL)[-1]
        new = outcome(record)
        np.testing.assert_array_equal(orange[new.proposed, 0], new.particles.innovation[:, 0])
        assert all(
            (orange[target] == new.particles.innovation[new.proposed == target]).all(axis=1).any()
            for target in new.proposed
        )


def test_more_dimensions_are_refused():
    with pytest.raises(ValueError, match="1 or 2 dimensions, the model has 4"):
        plot_step(step("condensation", "plane"), disc_model())


@lru_cache(maxsize=1)
def tracked():
    return next(iter(track(DiscVideo(), disc_model(), make_filter("rb-ss-hs-sir", 60))))


@pytest.mark.parametrize("close_up", [True, False])
def test_a_frame_is_shown_with_dark_likely_contours_and_the_expected_one_in_white(close_up):
    model, item = disc_model(), tracked()
    figure = plot_frame(item.image, model, item.record, truth=model.estimate_of(model.start), close_up=close_up)
    assert len(figure.axes) == 1 + close_up
    for axes in figure.axes:
        assert (np.asarray(axes.images[0].get_array()) == item.image[..., ::-1]).all()
        outlines = [
            (np.asarray(c.get_edgecolor())[0, :3].sum(), c.get_paths())
            for c in axes.collections
            if isinstance(c, PolyCollection)
        ]
        (white,) = [paths for brightness, paths in outlines if brightness == 3.0]
        np.testing.assert_allclose(white[0].vertices[:-1], model.contour.outlines(item.estimate.state)[0])
        dark = {len(paths) for brightness, paths in outlines if brightness < 0.3}
        assert dark == {1, len(likely_states(item.record, 14))} and max(dark) > 5


def test_the_white_contour_is_where_the_pixels_say():
    model, item = disc_model(), tracked()
    png = render(plot_frame(item.image, model, item.record, close_up=False), "png", 100)
    picture = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    zoom = picture.shape[0] / item.image.shape[0]
    outline = np.rint(model.contour.outlines(item.estimate.state)[0] * zoom - 0.5).astype(int)
    assert np.median(picture[outline[:, 1], outline[:, 0]].min(axis=1)) > 225
    corner = picture[4:30, 4:30].reshape(-1, 3).mean(axis=0)
    np.testing.assert_allclose(corner, item.image[1:6, 1:6].reshape(-1, 3).mean(axis=0), atol=3)


def test_a_frame_of_another_size_is_refused():
    with pytest.raises(ValueError, match=r"expected a frame of \(96, 72\), got \(40, 30\)"):
        plot_frame(disc_frame(0)[:30, :40], disc_model(), tracked().record)


def trace_of(name: str, steps: int = 12) -> Trace:
    world = get_world("figure-1")
    filter_ = make_filter(name, 12)
    trace = Trace(filter_.initial(step_rng(0, 0), world.model))
    for record in run(filter_, world.model, world.record(0, steps).observations):
        trace.append(record)
    return trace


def test_courses_are_read_from_the_records():
    trace, errors, increments = trace_of("rb-hs-sir"), np.arange(12.0), np.full(12, -0.5)
    course = course_of(trace, "RB-HS-SIR", errors, increments)
    other = course_of(trace_of("hs-sir"), "HS-SIR", last=8)
    assert course.times.tolist() == list(range(1, 13)) and other.times.tolist() == list(range(1, 9))
    figure = plot_courses([course, other], title="two runs")
    lines = {axes.get_title(loc="left"): [line.get_xydata() for line in axes.get_lines()] for axes in figure.axes}
    assert len(lines) == len(PANELS)
    ess = [100 * record.effective_sample_size / 12 for record in trace]
    np.testing.assert_allclose(lines["effective sample size, % of N"][0][:, 1], ess)
    np.testing.assert_allclose(lines["error: distance from the truth"][0][:, 1], errors)
    evidence = np.cumsum([record.log_evidence for record in trace])
    np.testing.assert_allclose(lines["log-evidence so far"][0][:, 1], evidence)
    np.testing.assert_allclose(lines["weight held by the lightest, %"][0][-1], [100, 100])
    against = plot_courses([course], ["evidence"]).axes[0]
    np.testing.assert_allclose(against.get_lines()[0].get_ydata(), evidence - np.cumsum(increments))
    weighed = trace[12].stage("weight")
    assert weighed is not None
    np.testing.assert_allclose(np.sort(course.weights), np.sort(weighed.particles.weights))
    assert course.ancestors[0] == 12 and len(course.ancestors) == 13


def test_what_cannot_be_drawn_is_said():
    trace = trace_of("condensation", 3)
    with pytest.raises(ValueError, match="errors must be one for each of 3 records, got 2"):
        course_of(trace, "x", [1.0, 2.0])
    with pytest.raises(ValueError, match="nothing is recorded up to time 0"):
        course_of(trace, "x", last=0)
    with pytest.raises(ValueError, match="courses must be 1 to 4 runs, got 0"):
        plot_courses([])
    with pytest.raises(ValueError, match=r"panels must be among ess, .*, got 'es'"):
        plot_courses([course_of(trace, "x")], ["es"])
    with pytest.raises(ValueError, match="format must be one of png, svg, pdf, got 'jpg'"):
        render(plot_courses([course_of(trace, "x")]), "jpg")


def example(name: str = "rb-hs-sir") -> Figure:
    return plot_courses([course_of(trace_of(name), name)], ["ess", "weights"])


def test_files_are_what_they_are_called():
    png, svg, pdf = (render(example(), kind, 50) for kind in ("png", "svg", "pdf"))
    picture = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    width, height = example().get_size_inches()
    assert picture.shape[:2] == (int(50 * height), int(50 * width))
    assert b"<svg" in svg[:600] and b"<image" not in svg and svg.rstrip().endswith(b"</svg>")
    assert pdf.startswith(b"%PDF-") and b"/FontFile2" in pdf and b"/Subtype /Image" not in pdf
    assert b"/CreationDate" not in pdf and b"<dc:date>" not in svg


@pytest.mark.parametrize("kind", ["png", "svg", "pdf"])
def test_equal_records_give_equal_bytes_in_any_thread(kind):
    alone = render(example(), kind)
    with ThreadPoolExecutor(2) as pool:
        together = list(pool.map(lambda name: render(example(name), kind), ["rb-hs-sir", "basic-sir"]))
    assert together[0] == alone != together[1]


def test_no_pyplot_and_no_matplotlib_before_it_is_needed():
    program = """
import json, sys
import pfviz.figures as figures
before = "matplotlib" in sys.modules
from pfviz import get_world, make_filter, run
world = get_world("figure-1")
record = next(run(make_filter("basic-sir", 5), world.model, world.record(0, 1).observations))
figures.render(figures.plot_step(record, world.model))
print(json.dumps([before, "matplotlib" in sys.modules, "matplotlib.pyplot" in sys.modules]))
"""
    program = f"import sys; sys.path.insert(0, {str(ROOT / 'src')!r})\n{program}"
    plain = os.environ | {"PFVIZ_NO_NUMBA": "1"}
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, env=plain)
    assert json.loads(done.stdout) == [False, True, False]
