"""``pfviz toy``: its lines are all that a reader needs to check it."""

import json
from importlib import metadata

import numpy as np
import pytest
from oracles import LinearGaussian, dense_joint, textbook_kalman
from pfviz_app.cli import main

from pfviz.filters import FILTERS
from pfviz.worlds import WORLDS

KEYS = ["t", "truth", "observation", "mean", "covariance", "exact_mean", "exact_covariance", "ess"]
KEYS += ["log_evidence", "exact_log_evidence"]


@pytest.fixture(autouse=True)
def _version(monkeypatch: pytest.MonkeyPatch) -> None:
    """The version is that of the installed package; the tests also run from a bare checkout."""
    try:
        metadata.version("pfviz")
    except metadata.PackageNotFoundError:
        monkeypatch.setattr("pfviz_app.commands_toy.version", lambda name: "0")


def lines(capsys: pytest.CaptureFixture[str], *words: str) -> list[dict]:
    main(["toy", *words, "--json"])
    return [json.loads(line) for line in capsys.readouterr().out.splitlines()]


@pytest.mark.parametrize("oracle", [textbook_kalman, dense_joint])
@pytest.mark.parametrize("world", [n for n, w in WORLDS.items() if w.model.observation_covariance is not None])
def test_exact_columns_follow_from_the_first_line(capsys, world, oracle):
    header, *steps = lines(capsys, "--world", world, "--steps", "12", "--seed", "5", "--particles", "10")
    model = LinearGaussian.of_line(header["model"])
    observations = np.array([step["observation"] for step in steps])
    for step, answer in zip(steps, oracle(model, observations), strict=True):
        np.testing.assert_allclose(step["exact_mean"], answer.mean, atol=1e-9, rtol=0)
        np.testing.assert_allclose(step["exact_covariance"], answer.covariance, atol=1e-9, rtol=0)
        assert step["exact_log_evidence"] == pytest.approx(answer.log_evidence, abs=1e-9)


def test_what_was_not_seen_is_null(capsys):
    words = ("--world", "occlusion", "--particles", "5", "--steps", "64", "--seed", "1")
    missing = [step["t"] for step in lines(capsys, *words)[1:] if step["observation"] is None]
    assert missing == list(range(51, 63))


@pytest.mark.parametrize("name", FILTERS)
def test_the_contract_of_the_columns(capsys, name):
    words = ("--world", "linear-gaussian", "--filter", name, "--particles", "30", "--steps", "4", "--seed", "3")
    header, *steps = lines(capsys, *words)
    assert {key: header[key] for key in ("world", "filter", "particles", "seed")} == {
        "world": "linear-gaussian",
        "filter": name,
        "particles": 30,
        "seed": 3,
    }
    assert [step["t"] for step in steps] == [1, 2, 3, 4]
    for step in steps:
        assert set(KEYS) <= set(step)
        assert 1.0 - 1e-9 <= step["ess"] <= 30.0 + 1e-9
        assert np.shape(step["mean"]) == (1,) and np.shape(step["covariance"]) == (1, 1)


@pytest.mark.parametrize("world", WORLDS)
def test_every_world_can_be_printed_and_read(capsys, world):
    header, *steps = lines(capsys, "--world", world, "--steps", "3", "--particles", "20")
    k = len(steps[0]["mean"])
    p = len(header["model"]["coefficients"])
    assert np.shape(header["model"]["prior_covariance"]) == (p * k, p * k)
    assert all(np.isfinite(step["mean"]).all() for step in steps)


def test_the_command_is_reproducible_and_repeats_seeds(capsys):
    words = ("--world", "plane", "--steps", "3", "--particles", "20")
    both = lines(capsys, *words, "--seed", "7", "--repeat", "2")
    assert [line["seed"] for line in both] == [7] * 4 + [8] * 4
    for seed, part in ((7, both[:4]), (8, both[4:])):
        alone = lines(capsys, *words, "--seed", str(seed))
        assert [{k: v for k, v in line.items() if k != "seed"} for line in part] == [
            {k: v for k, v in line.items() if k != "seed"} for line in alone
        ]


def test_the_estimates_agree_with_the_exact_answer(capsys):
    """z-scores of the posterior mean over seeds, with many particles."""
    for name in ("condensation", "rb-hs-sir"):
        all_lines = lines(
            capsys, "--filter", name, "--particles", "400", "--steps", "3", "--seed", "0", "--repeat", "40"
        )
        last = [line for line in all_lines if line.get("t") == 3]
        differences = np.array([(line["mean"][0] - line["exact_mean"][0]) for line in last])
        assert abs(differences.mean()) < 5 * differences.std(ddof=1) / np.sqrt(40)
        assert differences.std() < 0.1


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--particles", "0"], "--particles"),
        (["--particles", "many"], "many"),
        (["--filter", "basic-sri"], "did you mean 'basic-sir'"),
        (["--world", "plain"], "did you mean 'plane'"),
        (["--steps", "-1"], "--steps"),
    ],
)
def test_bad_input_is_one_line_and_exit_2(capsys, words, message):
    with pytest.raises(SystemExit) as stop:
        main(["toy", *words])
    error = capsys.readouterr().err.strip()
    assert stop.value.code == 2
    assert error.startswith("pfviz: error: ") and "\n" not in error and message in error
