"""Every experiment in a small version: the rows are right, and the sentences follow from them."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from small_experiments import ONE_CELL, PLACE, run_here, small

from pfviz.experiments import equal_time, noise_robustness, real_clips, recovery, regime_map, tracking, unbiasedness
from pfviz.experiments.experiment import ExperimentError, Row
from pfviz.experiments.registry import EXPERIMENTS, get_experiment
from pfviz.experiments.small import get_small_experiment
from pfviz.experiments.summary import Summary, Table

SEEDS = {"recovery": 1, "noise-robustness": 1, "unbiasedness": 3}


@cache
def outcome(name: str) -> tuple[list[Row], Summary]:
    if name == "loss-probability":
        rows, _ = outcome("tracking-error")
        return rows, small(name).summarise(rows)
    return run_here(small(name), SEEDS.get(name, 2))


def table(summary: Summary, name: str) -> Table:
    return next(table for table in summary.tables if table.name == name)


def tracked(label: str, seed: int, error: float, lost: float = 0.0, place: str = PLACE) -> Row:
    """A row as the tracking experiment has it, made up."""
    distances = [error] * 10 if lost < 1.0 else [90.0] * 10
    return {
        "place": place, "label": label, "filter": "condensation", "particles": 100, "seed": seed,
        "distances": distances, "error": error, "capped": error, "lost": lost, "lost_at_end": int(lost > 0),
        "twin": 1.0 if lost else None, "ess_share": 0.1, "proposal_spread": 4.0, "posterior_spread": 1.0,
        "near_share": 0.5, "variance": 5.0, "sharpness": 5.0, "milliseconds": 1.0,
    }  # fmt: skip


@pytest.mark.parametrize("name", [name for name in EXPERIMENTS if name != "real-clips"])
def test_rows_carry_their_seed_and_settings_and_the_summary_is_whole(name):
    rows, summary = outcome(name)
    assert {row["seed"] for row in rows} >= set(range(SEEDS.get(name, 2)))
    assert all({"place", "filter", "particles", "milliseconds"} <= set(row) for row in rows)
    assert summary.tables and summary.figures and summary.sentences
    for each in summary.tables:
        assert each.rows or each.name == "correlations", each.name
        assert all(len(line) == len(each.columns) for line in each.rows), each.name
        assert len(set(each.columns)) == len(each.columns), each.name
    assert len({each.name for each in summary.tables}) == len(summary.tables)
    assert not [sentence for sentence in summary.sentences if "nan" in sentence]


@pytest.mark.parametrize("name", [name for name in EXPERIMENTS if name != "real-clips"])
def test_the_full_size_is_listed_without_running_it(name):
    experiment = get_experiment(name)
    jobs = experiment.jobs(experiment.seeds)
    assert len({job.key for job in jobs}) == len(jobs)
    assert {seed for job in jobs for seed in job.seeds} >= set(range(experiment.seeds))


@pytest.mark.parametrize("name", [name for name in EXPERIMENTS if name != "real-clips"])
def test_part_of_the_rows_can_be_summarised(name):
    rows, _ = outcome(name)
    experiment = small(name)
    for part in (rows[:1], rows[: len(rows) // 2]):
        assert isinstance(experiment.summarise(part), Summary)
    experiment.summarise([])


def test_equal_time_finds_the_number_of_particles_that_takes_the_budget():
    counts = [100, 200, 400, 800]
    assert equal_time.affordable(counts, [1.0, 2.0, 4.0, 8.0], 3.0) == pytest.approx(300.0)
    assert equal_time.affordable(counts, [1.0, 2.0, 4.0, 8.0], 9.0) is None
    assert equal_time.affordable(counts, [1.0, 2.0, 4.0, 8.0], 0.5) is None
    shuffled = equal_time.affordable([800, 100, 400, 200], [8.0, 1.0, 4.0, 2.0], 3.0)
    assert shuffled == pytest.approx(300.0)


def test_equal_time_gives_the_number_of_each_round():
    def of_round(seed: int, slowness: float) -> list[Row]:
        base = {"place": "scene:twin", "seed": seed}
        budget = {**base, "filter": "condensation", "particles": 2000, "milliseconds": 4.0, "budget": True}
        ladder = [
            {**base, "filter": "rb-ss-hs-sir", "particles": n, "milliseconds": slowness * n / 100, "budget": False}
            for n in (100, 400, 1600)
        ]
        return [budget, *ladder]

    summary = equal_time.summarise([*of_round(0, 1.0), *of_round(1, 0.5)])
    (line,) = table(summary, "equal-time").rows
    assert line[0] == "RB-SS-HS-SIR"
    assert line[1] == pytest.approx((400 + 800) / 2)
    assert line[-2:] == (2, 400)


def test_orderings_follow_the_rows():
    rows = [
        tracked(label, seed, error + 0.01 * seed)
        for seed in range(8)
        for label, error in (("CONDENSATION(5)", 1.0), ("CONDENSATION(3)", 2.0), ("Basic-SIR", 0.5))
    ]
    verdicts = {line[1]: line[-1] for line in tracking.orderings(rows, "error").rows}
    assert verdicts["CONDENSATION(5) < CONDENSATION(3)"] == "holds"
    assert verdicts["CONDENSATION(5) < Basic-SIR"] == "the other way about"
    assert verdicts["RB-SS-HS-SIR < Basic-SIR"] == "not measured"
    noisy = [tracked(row["label"], row["seed"], float(np.sin(17 * i))) for i, row in enumerate(rows)]
    assert {line[-1] for line in tracking.orderings(noisy, "error").rows} == {"not seen", "not measured"}


def test_equality_is_refuted_only_by_a_difference():
    alike = [tracked(label, s, 1.0 + 0.1 * np.sin(3 * s + i)) for s in range(9)
             for i, label in enumerate(("RB-SS-HS-SIR", "CONDENSATION(5)"))]  # fmt: skip
    assert tracking.orderings(alike, "error").rows[0][-1] == "holds as far as can be told"
    apart = [tracked(label, s, 1.0 + i + 0.1 * np.sin(s)) for s in range(9)
             for i, label in enumerate(("RB-SS-HS-SIR", "CONDENSATION(5)"))]  # fmt: skip
    assert tracking.orderings(apart, "error").rows[0][-1] == "does not hold: RB-SS-HS-SIR is better"


def test_arbitrary_associations_cost_much_only_where_histories_lie_apart():
    def said(apart: float, gain: float) -> str:
        rows = [
            tracked(label, seed, 1.0)
            | {"ess_share": 0.1 + 0.001 * np.cos(5 * seed) + (gain if label == "RB-SS-HS-SIR" else 0.0)}
            | {"posterior_spread": apart}
            for seed in range(8)
            for label in ("Basic-SIR", "RB-SS-HS-SIR")
        ]
        return tracking.association_sentence(rows)[0]

    assert "ESS share is greater than" in said(1.0, 0.05) and "costs little" in said(1.0, 0.05)
    assert "ESS share is smaller than" in said(9.0, -0.05) and "costs much" in said(9.0, -0.05)
    assert tracking.association_sentence([tracked("Basic-SIR", 0, 1.0)]) == []


def test_what_the_error_goes_with_is_said_only_where_it_does():
    rows = [
        tracked("RB-SS-HS-SIR", seed, float(scene), place=f"scene:twin:{scene}")
        | {"ess_share": -scene + 0.1 * seed, "sharpness": float(np.sin(9 * scene))}
        for scene in range(12)
        for seed in range(2)
    ]
    (said,) = tracking.correlation_sentences(tracking.correlations(rows))
    assert "error of RB-SS-HS-SIR falls with the ESS share (rank correlation -1.00" in said


def test_curves_of_error_and_loss_are_the_papers():
    rows = [tracked("A", 0, 2.0), tracked("A", 1, 4.0), tracked("A", 2, 0.0, lost=1.0)]
    error, loss = tracking.error_curve("A", rows), tracking.loss_curve("A", rows)
    np.testing.assert_allclose(error.y, 3.0)
    np.testing.assert_allclose(loss.y, 1 / 3)
    assert loss.low is not None and loss.high is not None
    assert (loss.low > 0.0).all() and (loss.high < 1.0).all()


def test_the_variances_of_the_texts_are_those_of_the_dynamics():
    from pfviz.experiments.trackers import believed, film

    for variance in (3.0, 5.0, 10.0):
        model = believed(film(PLACE).model, 1.0, 1.0, variance)
        np.testing.assert_allclose(np.diag(model.dynamics.noise_covariance)[:2], variance)
    assert [arm.label for arm in tracking.arms(["condensation"])] == [f"CONDENSATION({v})" for v in (3, 5, 10)]


def test_tracking_rows_hold_together():
    rows, _ = outcome("tracking-error")
    for row in rows:
        away = np.array(row["distances"])
        assert len(away) == 150
        assert row["lost"] == pytest.approx(np.mean(away > 50.0))
        assert row["error"] == pytest.approx(away[away <= 50.0].mean(), abs=0.01)
        assert 0.0 < row["ess_share"] <= 1.0
    near = {row["label"]: row["near_share"] for row in rows}
    assert near["CONDENSATION(5)"] > near["Basic-SIR"]


def test_error_and_loss_share_their_rows():
    error, loss = get_experiment("tracking-error"), get_experiment("loss-probability")
    assert error.origin == loss.origin == "tracking"
    assert [job.key for job in error.jobs(3)] == [job.key for job in loss.jobs(3)]


def test_noise_that_is_taken_for_too_small_hurts_condensation_more_on_the_toy_world():
    rows, _ = outcome("noise-robustness")
    toy = [row for row in rows if row["place"] == "linear-gaussian"]
    base, rival = (
        noise_robustness.degradation([row for row in toy if row["label"] == label], 0.25)
        for label in ("CONDENSATION", "RB-SS-HS-SIR")
    )
    gaps = np.array([base[key] - rival[key] for key in base])
    assert len(gaps) == 10
    assert gaps.mean() / (gaps.std(ddof=1) / np.sqrt(len(gaps))) > 3


def test_degradation_is_against_the_same_run_with_the_right_noise():
    rows = [
        {"place": "plane", "seed": seed, "system": factor, "error": factor * (1 + seed), "label": "A"}
        for seed in (0, 1)
        for factor in (1.0, 4.0)
    ]
    assert noise_robustness.degradation(rows, 4.0) == {("plane", 0): 3.0, ("plane", 1): 6.0}


@pytest.mark.parametrize(
    ("of_base", "of_rival", "verdict"),
    [
        (3.0, 1.0, "CONDENSATION degrades more, as the text says"),
        (1.0, 3.0, "RB-SS-HS-SIR degrades more, against the text"),
        (-1.0, -3.0, "CONDENSATION fares worse, but does not degrade"),
        (0.0, -3.0, "CONDENSATION fares worse, but does not degrade"),
        (1.0, 1.0, "which degrades more cannot be told"),
    ],
)
def test_who_does_not_degrade_is_not_said_to(of_base, of_rival, verdict):
    growths = {"CONDENSATION": of_base, "RB-SS-HS-SIR": of_rival}
    rest = {"place": "plane", "group": "plane", "lost": 0.0, "ess_share": 0.5}
    rows = [
        {**rest, "label": label, "seed": seed, "system": factor, "error": 5.0 + (factor - 1.0) * growth}
        for label, growth in growths.items()
        for seed in range(8)
        for factor in (1.0, 2.0)
    ]
    for row, noise in zip(rows, np.random.default_rng(0).normal(0.0, 0.1, len(rows)), strict=True):
        row["error"] += noise
    (sentence,) = noise_robustness.summarise(rows).sentences
    assert sentence.endswith(f": {verdict}.")


def test_a_wait_ends_where_the_object_is_found_for_good():
    near = np.array([0, 1, 0, 0, 1, 1, 1, 1, 1, 0], dtype=bool)
    assert recovery.first_run(near, 5) == (4.0, True)
    assert recovery.first_run(near, 1) == (1.0, True)
    assert recovery.first_run(near, 6) == (10.0, False)
    assert recovery.first_run(near[:2], 5) == (2.0, False)


def test_waits_are_counted_from_every_jump_of_the_toy_world():
    away = np.full(149, 9.0)
    away[0:24] = 0.0
    away[24 + 3 :: 25] = 0.0
    row = {"place": "recovery", "distances": away.tolist()}
    assert recovery.waits(row) == [(3.0, True)] * 5


def test_a_filter_that_starts_elsewhere_begins_far_from_the_object():
    rows, _ = outcome("recovery")
    films = [row for row in rows if row["place"] == PLACE]
    assert {row["start"] for row in films} == {"nowhere", "twin"}
    plain = [row for row in films if row["filter"] == "condensation" and not row.get("restarting")]
    assert min(row["distances"][0] for row in plain) > 40.0
    jumps = [wait for row in rows if row["place"] == "recovery" for wait in recovery.waits(row)]
    assert np.mean([wait for wait, _ in jumps]) > 1.0


def test_history_sampling_recovers_sooner_on_the_toy_world():
    rows, _ = outcome("recovery")
    toy = [row for row in rows if row["place"] == "recovery"]
    base, rival = (
        recovery.waits_by_run([row for row in toy if row["label"] == label])
        for label in ("CONDENSATION", "RB-SS-HS-SIR")
    )
    gaps = np.array([base[key] - rival[key] for key in base])
    assert gaps.mean() / (gaps.std(ddof=1) / np.sqrt(len(gaps))) > 5


def test_a_cell_of_the_map_goes_to_the_smaller_error():
    def cell(name: str, count: int, seed: int, error: float, milliseconds: float) -> Row:
        settings = {"system": 1.0, "observation": 1.0, "proposal": 1.0}
        named = {"place": "linear-gaussian", "label": name, "filter": name, "particles": count, "seed": seed}
        return {**named, **settings, "excess": error, "ess_share": 0.5, "milliseconds": milliseconds}

    rows = [
        cell(name, count, seed, error + 0.01 * np.sin(seed + count), time)
        for seed in range(8)
        for name, count, error, time in (
            ("condensation", 100, 1.0, 1.0),
            ("condensation", 400, 0.2, 4.0),
            ("rb-ss-hs-sir", 100, 0.5, 4.5),
        )
    ]
    (region,) = regime_map.regions(rows)
    (payoff,) = regime_map.payoff_table(region).rows
    (in_time,) = regime_map.in_time_table(region).rows
    assert payoff[-1] == "RB-SS-HS-SIR"
    assert in_time[5] == 400
    assert in_time[-1] == "CONDENSATION"


def test_matched_data_are_drawn_with_the_noise_of_the_cell():
    from pfviz.experiments.measure import exact_run

    factors = (3.0, 1.0, 1.0)
    right, model, exact = exact_run("linear-gaussian", 0, 400, factors, True)
    wrong, _, _ = exact_run("linear-gaussian", 0, 400, factors, False)
    assert exact is not None
    assert np.diff(right.truth[:, 0]).std() > 2.0 * np.diff(wrong.truth[:, 0]).std()
    scaled = (exact.means - right.truth) / exact.deviations
    assert np.mean(scaled**2) == pytest.approx(1.0, abs=0.4)
    assert model.dynamics.noise_covariance[0, 0] == pytest.approx(9 * 0.09)


def test_evidence_ratios_tell_a_biased_filter_from_an_unbiased_one():
    def row(name: str, seed: int, log_ratio: float | None) -> Row:
        settings = {"place": "linear-gaussian", "label": name, "filter": name, "particles": 100, "seed": seed}
        return {**settings, "log_evidence_ratio": log_ratio, "excess": 0.1, "ess_share": 0.5, "milliseconds": 1.0}

    logs = np.random.default_rng(0).normal(-0.02, 0.2, 400)
    rows = [row("rb-hs-sir", seed, value) for seed, value in enumerate(logs)]
    rows += [row("ls-n-ips", seed, value + 0.5) for seed, value in enumerate(logs)]
    lines = {line[0]: line for line in table(unbiasedness.summarise(rows), "evidence-ratios").rows}
    assert abs(lines["RB-HS-SIR"][6]) < 4 < lines["LS-N-IPS"][6]
    assert unbiasedness.ratio([row("rb-hs-sir", 0, 0.0), row("rb-hs-sir", 1, None)]).value == 0.5


def test_icondensation_is_off_where_the_noise_is_small():
    _, summary = outcome("unbiasedness")
    bias = {(line[0], line[1]): line[5] for line in table(summary, "icondensation-bias").rows}
    assert set(bias) == {(0.25, 1.0), (4.0, 1.0)}
    assert bias[0.25, 1.0] > 0.3 > bias[4.0, 1.0]


def test_without_clips_there_is_one_line(monkeypatch, tmp_path):
    monkeypatch.delenv("PFVIZ_CLIPS", raising=False)
    with pytest.raises(ExperimentError, match="PFVIZ_CLIPS is not set"):
        get_experiment("real-clips").jobs(1)
    monkeypatch.setenv("PFVIZ_CLIPS", str(tmp_path / "none"))
    with pytest.raises(ExperimentError, match="there is no folder"):
        get_experiment("real-clips").jobs(1)
    monkeypatch.setenv("PFVIZ_CLIPS", str(tmp_path))
    with pytest.raises(ExperimentError, match="no clips in"):
        get_experiment("real-clips").jobs(1)


def test_a_clip_is_tracked_against_its_truth(monkeypatch, tmp_path):
    from dataclasses import replace

    from pfviz.vision.drawing import VideoWriter
    from pfviz.vision.scenes import Scene

    folder = tmp_path / "disc"
    folder.mkdir()
    scene, lines = Scene(1), ["frame,x,y,w,h,cx,cy"]
    with VideoWriter(str(folder / "video.mp4"), scene.size, scene.frame_rate) as writer:
        for index in range(24):
            writer.write(scene.read(index))
            if index != 10:
                x, y, w, h = scene.box(index)
                lines.append(f"{index},{x},{y},{w},{h},{scene.truth(index)[0]},{scene.truth(index)[1]}")
    (folder / "truth.csv").write_text("\n".join(lines))
    monkeypatch.setenv("PFVIZ_CLIPS", str(tmp_path))
    experiment = get_experiment("real-clips")
    few = replace(experiment, jobs=lambda seeds: real_clips.jobs(seeds, ["rb-ss-hs-sir"], 0.2))
    (row, _), summary = run_here(few, 2)
    assert row["place"] == "clip:disc"
    assert row["distances"][10] is None
    assert len(row["distances"]) == 24
    assert row["error"] < 4.0
    assert table(summary, "real-clips").rows[0][:2] == ("disc", "RB-SS-HS-SIR")


def test_the_map_needs_no_more_than_its_cells():
    assert len(regime_map.jobs(1, ONE_CELL, ONE_CELL, [PLACE], (25,), (50,), ((), (9,)))) == 3 + (3 + 1)


def test_every_experiment_has_a_small_version(monkeypatch, tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "truth.csv").touch()
        (tmp_path / name / "video.mp4").touch()
    monkeypatch.setenv("PFVIZ_CLIPS", str(tmp_path))
    for name, experiment in EXPERIMENTS.items():
        little = get_small_experiment(name)
        jobs, full = little.jobs(little.seeds), experiment.jobs(experiment.seeds)
        assert 0 < sum(len(job.seeds) for job in jobs) < 0.3 * sum(len(job.seeds) for job in full)
        assert little.run is experiment.run
        assert "in small" in little.title
