"""Lost and found: the verdict over time, and the particles that start anew."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from vision_clips import clip

from pfviz.filters import make_filter
from pfviz.filters.steps import FilterError
from pfviz.randomness import step_rng
from pfviz.record import StepRecord
from pfviz.vision.presence import AT_START, NOT_YET_FOUND, Presence, PresenceRule, is_restart, weighed_posterior
from pfviz.vision.restart import Restarting
from pfviz.vision.track import TrackedFrame, track
from pfviz.vision.tracker import TrackerModel, learn_tracker
from pfviz.vision.video import EndOfVideo, Image, open_source

RULE = PresenceRule(object_score=10.0, background_score=-10.0)
HIDDEN = range(30, 42)
BEHIND_A_WALL = range(18, 26)


class Blinking:
    """A red disc on noise, which moves to and fro, and is not to be seen in some frames."""

    name, size, frame_rate, frame_count = "blinking", (160, 120), 30.0, 60

    def __init__(self, absent: range, moved: float = 0.0) -> None:
        self._absent, self._moved = absent, moved
        grain = np.random.default_rng(0).integers(60, 150, (15, 20, 3))
        self._back = grain.repeat(8, axis=0).repeat(8, axis=1).astype(np.uint8)

    def centre(self, index: int) -> tuple[float, float]:
        jump = self._moved if index >= self._absent.stop else 0.0
        return 45.0 + 0.8 * index + jump, 60.0 + 12.0 * np.sin(0.15 * index)

    def read(self, index: int) -> Image:
        if index >= self.frame_count:
            raise EndOfVideo("over")
        noise = np.random.default_rng(index).integers(0, 8, self._back.shape)
        image = self._back + noise.astype(np.uint8)
        if index not in self._absent:
            y, x = np.mgrid[0:120, 0:160] + 0.5
            cx, cy = self.centre(index)
            image[np.hypot(x - cx, y - cy) < 12.0] = (40, 30, 220)
        return image

    def model(self, index: int) -> TrackerModel:
        x, y = self.centre(index)
        return learn_tracker(self.read(index), (x - 12, y - 12, 24, 24))


def tracked(source: Blinking, model: TrackerModel, name: str, seed: int = 0, share: float = 0.25) -> list[TrackedFrame]:
    return list(track(source, model, Restarting(make_filter(name, n_particles=200), share), seed))


def is_near(source: Blinking, item: TrackedFrame) -> bool:
    x, y = source.centre(item.frame)
    return bool(np.hypot(item.estimate.x - x, item.estimate.y - y) < 6.0)


def follow(rule: PresenceRule, presence: Presence, scores: list[float]) -> list[Presence]:
    states = []
    for score in scores:
        presence = rule.after(presence, score)
        states.append(presence)
    return states


def test_the_probability_is_that_of_a_chain_of_two_states():
    """Against the forward recursion of a hidden Markov chain, written out."""
    scores = [9.0, 2.0, -3.0, -12.0, 1.0, 30.0]
    presence = Presence(0.7, True)
    belief = np.array([0.3, 0.7])
    chain = np.array([[1 - RULE.change, RULE.change], [RULE.change, 1 - RULE.change]])
    for score in scores:
        threshold = 10.0 - (0.55 if presence.tracked else 0.3) * 20.0
        ratio = np.exp(np.clip(8.0 * (score - threshold) / 20.0, -4.0, 4.0))
        belief = chain.T @ belief * [1.0, ratio]
        belief /= belief.sum()
        presence = RULE.after(presence, score)
        assert presence.probability == pytest.approx(belief[1])
        assert presence.score == score


def test_one_bad_frame_does_not_lose_the_object_and_several_do():
    bad = RULE.lost_threshold - 4.0
    verdicts = [p.status for p in follow(RULE, AT_START, [8.0, bad, 8.0, bad, bad, bad])]
    assert verdicts[:3] == ["tracked"] * 3
    assert verdicts[-1] == "lost"


def test_one_frame_of_background_is_enough():
    assert RULE.background_score < RULE.hopeless_threshold < RULE.lost_threshold < RULE.found_threshold
    assert [p.status for p in follow(RULE, AT_START, [8.0, RULE.background_score - 2.0])] == ["tracked", "lost"]


def test_between_the_thresholds_the_verdict_stays_as_it_is():
    between = [0.5 * (RULE.lost_threshold + RULE.found_threshold)] * 50
    assert all(p.tracked for p in follow(RULE, AT_START, between))
    assert not any(p.tracked for p in follow(RULE, NOT_YET_FOUND, between))


def test_it_is_found_when_it_scores_as_it_did():
    states = follow(RULE, NOT_YET_FOUND, [10.0] * 4)
    assert not states[0].tracked
    assert states[3].tracked


def test_without_an_observation_belief_goes_half_way_to_ignorance_and_the_verdict_stays():
    states = follow(RULE, AT_START, [float("nan")] * 400)
    assert states[-1].probability == pytest.approx(0.5, abs=1e-6)
    assert states[-1].tracked


def test_the_verdict_does_not_depend_on_the_scale_of_the_scores():
    scores = [8.0, -3.0, -9.0, 0.0, 4.0]
    plain = follow(RULE, AT_START, scores)
    scaled = follow(RULE.scaled(0.25), AT_START, [0.25 * s for s in scores])
    np.testing.assert_allclose([p.probability for p in scaled], [p.probability for p in plain])


def test_the_levels_are_those_of_the_object_and_of_what_is_not_it():
    source = Blinking(range(0))
    model = source.model(0)
    features = model.observe(source.read(0))
    assert model.presence_rule.object_score == model.log_likelihood(model.start[None], features)[0]
    rng = np.random.default_rng(9)
    away = np.concatenate([rng.uniform([80, 0], [160, 120], (400, 2)), rng.normal(0.0, [0.3, 0.1], (400, 2))], axis=1)
    scores = model.log_likelihood(away, features)
    assert model.presence_rule.background_score == pytest.approx(np.median(scores), abs=1.5)
    noisy = model.with_noise(observation=2.0)
    assert noisy.presence_rule.gap == pytest.approx(model.presence_rule.gap / 4.0)


@pytest.mark.parametrize("name", ["rb-ss-hs-sir", "condensation", "hs-sir", "icondensation"])
def test_an_object_that_comes_late_is_found_where_it_is(name):
    source = Blinking(range(BEHIND_A_WALL.start))
    items = tracked(source, source.model(25).given(NOT_YET_FOUND), name)
    assert {item.status for item in items[: BEHIND_A_WALL.start]} == {"lost"}
    assert {item.status for item in items[BEHIND_A_WALL.start + 8 :]} == {"tracked"}
    assert np.mean([is_near(source, item) for item in items[BEHIND_A_WALL.start + 8 :]]) > 0.95


@pytest.mark.parametrize("name", ["rb-ss-hs-sir", "condensation"])
def test_an_object_that_comes_back_elsewhere_is_lost_and_found(name):
    source = Blinking(HIDDEN, moved=40.0)
    items = tracked(source, source.model(0), name, seed=1)
    verdicts = [item.status for item in items]
    assert set(verdicts[: HIDDEN.start]) == {"tracked"}
    assert set(verdicts[HIDDEN.start + 5 : HIDDEN.stop]) == {"lost"}
    assert set(verdicts[HIDDEN.stop + 8 :]) == {"tracked"}
    assert all(is_near(source, item) for item in items[HIDDEN.stop + 8 :])


def frames_until_near(share: float, seed: int) -> int:
    """How many frames after it has come into view 25 particles find an object that may be anywhere; 20 if not."""
    source = Blinking(range(BEHIND_A_WALL.start))
    filter_ = Restarting(make_filter("condensation", n_particles=25), share)
    items = list(track(source, source.model(25).given(NOT_YET_FOUND), filter_, seed))
    near = [is_near(source, item) for item in items[BEHIND_A_WALL.start :][:20]]
    return near.index(True) if any(near) else 20


def test_restarts_are_what_finds_it():
    frames = np.array([[frames_until_near(share, seed) for share in (0.0, 0.25)] for seed in range(6)])
    assert frames[:, 1].sum() < 0.5 * frames[:, 0].sum()


def records_with_and_without_restart(name: str) -> tuple[StepRecord, StepRecord]:
    source = Blinking(HIDDEN)
    items = tracked(source, source.model(0), name, share=0.3)
    lost, found = items[HIDDEN.stop - 1].record, items[10].record
    assert is_restart(lost.stages[-1]) and not any(is_restart(stage) for stage in found.stages)
    return lost, found


@pytest.mark.parametrize("name", ["rb-ss-hs-sir", "condensation", "hs-sir"])
def test_a_restart_is_recorded_as_it_was_made(name):
    record, _ = records_with_and_without_restart(name)
    stage, before = record.stages[-1], record.stages[-2].particles
    assert stage.ancestors is not None and stage.histories is not None and stage.proposal is not None
    fresh = stage.histories == -1
    assert fresh.sum() == 60 and not fresh[:-60].any()
    np.testing.assert_allclose(stage.particles.weights, 1 / 200)
    np.testing.assert_array_equal(stage.particles.states[~fresh], before.states[stage.ancestors[~fresh]])
    earlier = record.stages[-2].histories
    assert earlier is not None
    np.testing.assert_array_equal(stage.histories[~fresh], earlier[stage.ancestors[~fresh]])
    anew = stage.particles.innovation[fresh]
    assert np.isfinite(stage.proposal.log_density(anew[:, :2])).all()
    assert len(np.unique(anew[:, 0])) == 60
    weighed = record.stage("weight")
    assert weighed is not None and weighed_posterior(record) is weighed.particles


@pytest.mark.parametrize("lost", [False, True])
@pytest.mark.parametrize(("name", "added"), [("rb-ss-hs-sir", ["resample"]), ("condensation", []), ("hs-sir", [])])
def test_a_step_is_that_of_the_filter_itself_while_the_object_is_there(lost, name, added):
    source = Blinking(range(0))
    start, inner = source.model(0), make_filter(name, n_particles=100)
    model = start.given(NOT_YET_FOUND if lost else AT_START)
    particles = inner.initial(step_rng(3, 0), start)
    features = model.observe(source.read(0))
    plain = inner.step(step_rng(3, 1), model, particles, features)
    wrapped = Restarting(inner).step(step_rng(3, 1), model, particles, features)
    assert [stage.kind for stage in wrapped.stages] == [stage.kind for stage in plain.stages] + added
    for one, other in zip(plain.stages, wrapped.stages, strict=False):
        np.testing.assert_array_equal(one.particles.states, other.particles.states)
        np.testing.assert_array_equal(one.particles.log_weights, other.particles.log_weights)
    assert plain.log_evidence == wrapped.log_evidence
    assert plain.effective_sample_size == wrapped.effective_sample_size
    assert model.estimate(plain) == model.estimate(wrapped)


class Kicked(Blinking):
    """The disc turns back at frame 20, faster than any hand could turn it."""

    def __init__(self) -> None:
        super().__init__(range(0))

    def centre(self, index: int) -> tuple[float, float]:
        return 20.0 + 5.0 * index if index <= 20 else 120.0 - 30.0 - 3.0 * (index - 20), 60.0


@pytest.mark.parametrize("name", ["rb-ss-hs-sir", "condensation"])
def test_an_object_that_turns_back_sharply_is_found_again_within_a_few_frames(name):
    source = Kicked()
    near = [is_near(source, item) for item in tracked(source, source.model(0), name)[:40]]
    assert all(near[:21]) and all(near[26:])


def test_the_proposal_is_gated_about_where_the_object_will_be_and_open_when_it_is_lost():
    source = Blinking(range(0))
    model = source.model(0)
    items = tracked(source, model, "rb-ss-hs-sir")
    ahead = np.array([item.presence.expected for item in items[5:40]])
    true = np.array([source.centre(item.frame + 1) for item in items[5:40]])
    still = np.array([source.centre(item.frame) for item in items[5:40]])
    assert np.hypot(*(ahead - true).T).mean() < 2.0
    assert np.hypot(*(ahead - true).T).mean() < np.hypot(*(still - true).T).mean()
    features = items[10].record.observation
    following = model.given(items[9].presence)
    assert model.proposal(features) is features.proposal
    gated = following.proposal(features)
    assert (gated.probabilities > 0.4 * features.proposal.probabilities).all()
    spread = [p.sample(np.random.default_rng(0), 2000).std(axis=0).max() for p in (gated, features.proposal)]
    assert spread[0] < 0.9 * spread[1]
    assert items[10].record.stage("propose").proposal.probabilities.tolist() == gated.probabilities.tolist()
    assert following.given(NOT_YET_FOUND).proposal(features) is features.proposal


def test_resampling_copies_particles_in_proportion_to_their_weights_and_drops_the_lightest():
    source = Blinking(range(0))
    model = source.model(0)
    filter_ = Restarting(make_filter("rb-ss-hs-sir", n_particles=100))
    record = filter_.step(step_rng(3, 1), model, filter_.initial(step_rng(3, 0), model), model.observe(source.read(0)))
    weighed, resampled = record.stages[-2:]
    assert resampled.ancestors is not None and weighed.histories is not None
    counts = np.bincount(resampled.ancestors, minlength=100)
    assert (np.abs(counts - 100 * weighed.particles.weights) < 1.0).all()
    assert (weighed.particles.weights < 1e-6).any() and not counts[weighed.particles.weights < 1e-6].any()
    np.testing.assert_array_equal(record.posterior.states, weighed.particles.states[resampled.ancestors])
    np.testing.assert_array_equal(record.histories, weighed.histories[resampled.ancestors])
    np.testing.assert_allclose(record.posterior.weights, 0.01)


def test_a_step_with_a_restart_can_be_replayed_alone():
    source = Blinking(HIDDEN)
    model, filter_ = source.model(0), Restarting(make_filter("rb-ss-hs-sir", n_particles=100))
    *_, before, item = list(track(source, model, filter_, 4))[: HIDDEN.stop]
    again = filter_.step(
        step_rng(4, item.frame + 1), model.given(before.presence), item.record.previous, item.record.observation
    )
    assert is_restart(again.stages[-1])
    np.testing.assert_array_equal(again.posterior.states, item.record.posterior.states)


def test_a_missing_frame_is_neither_scored_nor_searched():
    source = Blinking(range(0))
    model, filter_ = source.model(0), Restarting(make_filter("condensation", n_particles=50))
    searching = model.given(NOT_YET_FOUND)
    record = filter_.step(step_rng(0, 1), searching, filter_.initial(step_rng(0, 0), model), None)
    assert [stage.kind for stage in record.stages] == ["predict"]
    assert np.isnan(model.score(record))
    assert model.presence(AT_START, record).tracked


def test_the_prior_of_an_object_anywhere_fills_the_frame():
    model = Blinking(range(0)).model(0).given(NOT_YET_FOUND)
    states = model.sample_prior(np.random.default_rng(0), 4000)
    positions = states[:, 0, :2] / model.size
    assert (positions >= 0.0).all() and (positions < 1.0).all()
    counts, *_ = np.histogram2d(*positions.T, bins=4, range=[[0, 1], [0, 1]])
    chi_square = np.sum((counts - 250.0) ** 2) / 250.0
    assert chi_square < 15 + 5 * np.sqrt(30)
    speed = (states[:, 0] - states[:, 1]).std(axis=0)
    np.testing.assert_allclose(speed, model.prior_deviation[1], rtol=0.1)


def test_a_share_out_of_range_is_refused():
    with pytest.raises(FilterError, match=r"share must be between 0 and 1, got 1\.5"):
        Restarting(make_filter("condensation"), share=1.5)
    assert replace(Restarting(make_filter("condensation")), share=0.0).share == 0.0


def test_a_real_ball_that_enters_late_is_found():
    real = clip("greenball", 50, (515, 223, 54, 52))
    with open_source(real.path) as source:
        model = learn_tracker(source.read(real.start), real.box, frame_rate=source.frame_rate).given(NOT_YET_FOUND)
        statuses, distances = [], []
        for item in track(source, model, Restarting(make_filter("rb-ss-hs-sir", n_particles=400)), 2):
            statuses.append(item.status)
            if item.frame >= 36:
                distances.append(real.distance(item.frame, item.estimate.x, item.estimate.y))
            if item.frame == 54:
                break
    assert set(statuses[:28]) == {"lost"}
    assert set(statuses[36:]) == {"tracked"}
    assert max(distances) < 15.0


def test_what_is_known_of_one_step_is_not_taken_for_another(monkeypatch):
    """The model keeps the estimate and the score that it was asked for last, and only those."""
    source = Blinking(range(0))
    model, filter_ = source.model(0), Restarting(make_filter("rb-ss-hs-sir", 60))
    records, particles = [], filter_.initial(step_rng(0, 0), model)
    for t in (1, 2, 3):
        records.append(filter_.step(step_rng(0, t), model, particles, model.observe(source.read(t))))
        particles = records[-1].posterior
    expected = [(replace(model).estimate(record), replace(model).score(record)) for record in records]
    assert len({score for _, score in expected}) == 3
    for k in (0, 1, 1, 2, 0, 2):
        assert (model.estimate(records[k]), model.score(records[k])) == expected[k]
    place = expected[0][0]
    for record in records:
        assert model.score(record, place) == replace(model).score(record, place)
    calls = []
    monkeypatch.setattr("pfviz.vision.tracker.dominant_mean", lambda *_: calls.append(1))
    assert (model.estimate(records[2]), calls) == (expected[2][0], [])
