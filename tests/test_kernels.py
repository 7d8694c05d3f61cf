"""The compiled kernels against their NumPy twins, and both against independent oracles."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from threading import Thread

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.special import logsumexp

from pfviz import kernels

SOURCE = Path(kernels.__file__).resolve().parents[2]
NEARLY_ONE = np.nextafter(1.0, 0.0)


@pytest.fixture(autouse=True, scope="module")
def compiled_module():
    """The module of compiled kernels: a test of this file never compares a twin with itself."""
    kernels.warm_up()
    assert kernels.compiled_ready() and kernels.backend() == "numba"
    return sys.modules["pfviz.kernels.compiled"]


def run_python(program: str, **environment: str) -> str:
    """The output of ``program`` in a fresh interpreter."""
    done = subprocess.run(
        [sys.executable, "-W", "default", "-c", program],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(SOURCE), **environment},
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


# --- backend --------------------------------------------------------------------------------------------------

ONE_CALL = """
import sys
from pfviz import kernels
assert not kernels.compiled_ready()
assert "numba" not in sys.modules or sys.modules["numba"] is None
kernels.sample_histories([[0.0]], [[0.0], [1.0]], [0.0, 0.0], [[1.0]], [0.5])
print(kernels.backend(), kernels.compiled_ready())
"""


def test_the_first_call_compiles():
    assert run_python(ONE_CALL).split() == ["numba", "True"]


def test_the_environment_forces_numpy():
    assert run_python(ONE_CALL + "assert 'numba' not in sys.modules", PFVIZ_NO_NUMBA="1").split() == ["numpy", "False"]
    assert run_python(ONE_CALL, PFVIZ_NO_NUMBA="0").split() == ["numba", "True"]


def test_without_numba_the_twins_run_and_say_so():
    output = run_python("import sys; sys.modules['numba'] = None" + ONE_CALL)
    assert output.startswith("numpy False") and "running in plain NumPy" in output


def test_use_numpy_holds_for_its_block_and_thread_only():
    elsewhere = []
    with kernels.use_numpy():
        assert kernels.backend() == "numpy"
        thread = Thread(target=lambda: elsewhere.append(kernels.backend()))
        thread.start()
        thread.join()
    assert kernels.backend() == "numba" and elsewhere == ["numba"]


def test_use_numpy_runs_the_twins():
    rng = np.random.default_rng(0)
    histories = (rng.normal(size=(60, 2)), rng.normal(size=(50, 2)), np.zeros(50), np.eye(2))
    scan = (rng.random((30, 40)) < 0.1, rng.normal(size=(9, 2, 3)) * 9, rng.normal(size=(5, 2)), np.ones((5, 2)))
    cost = rng.random(7)
    motion = (rng.normal(size=(300, 1, 2)), None, [np.eye(2) / 3], np.ones(2), np.eye(2), 3)
    log_weights = rng.normal(size=400)
    with kernels.use_numpy():
        np.testing.assert_array_equal(
            kernels.sample_histories(*histories, np.full(60, 0.4))[0],
            kernels.sample_histories_numpy(*histories, np.full(60, 0.4))[0],
        )
        np.testing.assert_array_equal(
            kernels.log_mixture_density(*histories), kernels.log_mixture_density_numpy(*histories)
        )
        np.testing.assert_array_equal(kernels.scan_contours(*scan, cost), kernels.scan_contours_numpy(*scan, cost))
        np.testing.assert_array_equal(kernels.propagate(*motion), kernels.propagate_numpy(*motion))
        np.testing.assert_array_equal(
            kernels.normalise_log_weights(log_weights).weights,
            kernels.normalise_log_weights_numpy(log_weights).weights,
        )
        np.testing.assert_array_equal(
            kernels.systematic_ancestors(np.exp(log_weights), 0.3),
            kernels.systematic_ancestors_numpy(np.exp(log_weights), 0.3),
        )
    assert not np.array_equal(kernels.propagate(*motion), kernels.propagate_numpy(*motion))


@pytest.mark.parametrize(
    ("step", "error"),
    [
        ("__init__", RuntimeError("no locator available")),  # no writable folder
        ("save_overload", OSError("no space left on device")),
        ("load_overload", EOFError("ran out of input")),  # a damaged index
    ],
)
def test_trouble_with_the_cache_costs_only_time(compiled_module, monkeypatch, step, error):
    from numba.core.caching import FunctionCache

    troubles = []

    def fail(*_):
        troubles.append(step)
        raise error

    monkeypatch.setattr(FunctionCache, step, fail)
    double = compiled_module.types.float64
    twice = compiled_module.kernel(double(double))(lambda x: 2.0 * x)
    assert twice(4.0) == 8.0 and troubles == [step]


def test_kernels_take_read_only_writable_and_strided_arrays_without_compiling_anew(compiled_module):
    """Every kernel has explicit signatures, so what the callers do not bring to them would be an error."""
    rng = np.random.default_rng(1)
    for wrap in (np.asarray, np.asfortranarray, lambda a: a[..., ::-1], lambda a: a.astype(np.float32), _read_only):
        means, states = wrap(rng.normal(size=(20, 2))), wrap(rng.normal(size=(20, 3, 2)))
        weights = wrap(rng.random(20))
        kernels.sample_histories(means, means, weights, np.eye(2), weights % 1.0)
        kernels.propagate(states, np.arange(20, dtype=np.int32), np.zeros((3, 2, 2)), [0, 0], np.eye(2), 1)
        kernels.scan_contours(means > 1.0, wrap(rng.normal(size=(4, 2, 3))), means, means, weights)
        kernels.systematic_ancestors(weights, 0.5)
        kernels.normalise_log_weights(weights)
    for kernel in (compiled_module.propagate, compiled_module.scan_contours, compiled_module.sample_groups):
        assert len(kernel.signatures) == 1


def _read_only(array):
    array.flags.writeable = False
    return array


# --- history sampling -----------------------------------------------------------------------------------------


def dense_log_terms(innovations, means, log_weights, covariance):
    """The (M, N) matrix of log w_l N(u_i; m_l, covariance), by way of the precision matrix."""
    differences = innovations[:, None, :] - means[None, :, :]
    distances = np.einsum("mna,ab,mnb->mn", differences, np.linalg.inv(covariance), differences)
    log_determinant = np.linalg.slogdet(2.0 * np.pi * covariance)[1]
    return log_weights - 0.5 * (distances + log_determinant)


def cloud(d, n, m, seed=0, spread=3.0):
    rng = np.random.default_rng(seed)
    factor = rng.normal(size=(d, d)) + 2.0 * np.eye(d)
    weights = rng.dirichlet(np.ones(n))
    return [
        rng.normal(size=(m, d)) @ factor.T * spread,
        rng.normal(size=(n, d)) @ factor.T * spread,
        np.log(weights),
        factor @ factor.T,
    ]


def _far(case):
    case[0] += 50.0 * np.sqrt(np.diag(case[3])) * np.sign(case[0])
    return case


def _some_far(case):
    case[0][::3] *= 40.0
    return case


def _all_far(case):
    """So far that the histories' places within a cell's view have no digits left in single precision."""
    case[0] += 2e4 * np.sqrt(np.diag(case[3])) * np.sign(case[0])
    return case


def _clusters(case, factor=40.0):
    """Innovations and histories about five places, of weights that fall by 2**-200 from one to the next."""
    rng = np.random.default_rng(8)
    places = factor * rng.normal(size=(5, case[0].shape[1])) @ np.linalg.cholesky(case[3]).T
    own = rng.integers(0, 5, len(case[1]))
    case[0] += places[rng.integers(0, 5, len(case[0]))]
    case[1] += places[own]
    case[2] -= 140.0 * own
    return case


def _zero_weights(case):
    case[2][1::2] = -np.inf
    return case


def _one_hot(case):
    case[2][:] = -np.inf
    case[2][5] = 0.0
    return case


def _far_from_the_heaviest(case):
    n = len(case[2])
    case[2][:] = -300.0 * np.arange(n) / n
    case[2][-1] = -np.inf
    case[1][: n // 2] += 1e4
    return case


def _at_every_distance(case):
    """From amid the histories to where single, and then double precision underflow."""
    directions = case[0] / np.sqrt(np.einsum("mi,ij,mj->m", case[0], np.linalg.inv(case[3]), case[0]))[:, None]
    case[0] = directions * np.linspace(0.0, 60.0, len(directions))[:, None]
    return case


def _shifted(case):
    case[0] += 1e5
    case[1] += 1e5
    return case


def _one_outlier_of_no_weight(case):
    case[1][3] = 1e150
    case[2][3] = -np.inf
    return case


def _duplicates(case):
    case[1][:] = case[1][0]
    return case


def _unnormalised(case):
    case[2] += 500.0
    return case


def _at_the_edge_of_single_precision(case):
    """Histories as far out as single precision takes them, and innovations up to 9 sigma from the nearest."""
    factor = np.linalg.cholesky(case[3])
    n, d = case[1].shape
    rng = np.random.default_rng(5)
    corners = 56.0 / np.sqrt(d) * rng.choice([-1.0, 1.0], size=(n // 2, d))
    corners = np.concatenate([corners, -corners])
    directions = rng.normal(size=case[0].shape)
    directions *= rng.uniform(0.0, 9.0, (len(directions), 1)) / np.linalg.norm(directions, axis=1, keepdims=True)
    case[1] = corners @ factor.T
    case[0] = (corners[rng.integers(0, n, len(directions))] + directions) @ factor.T
    return case


ADVERSARIES = {
    "one dimension": cloud(1, 300, 200),
    "two dimensions": cloud(2, 1000, 300),
    "three dimensions": cloud(3, 200, 90),
    "five dimensions": cloud(5, 130, 90, spread=1.5),
    "one history": cloud(2, 1, 50),
    "one innovation": cloud(2, 400, 1),
    "two of each": cloud(2, 2, 2),
    "a block less one": cloud(2, 127, 40),
    "a block": cloud(2, 128, 40),
    "a block and one": cloud(2, 129, 40),
    "50 sigma away": _far(cloud(2, 200, 100)),
    "some 120 sigma away": _some_far(cloud(3, 200, 100)),
    "all far away": _all_far(cloud(2, 200, 100)),
    "clusters": _clusters(cloud(2, 700, 500, spread=1.0)),
    "clusters in four dimensions": _clusters(cloud(4, 700, 500, spread=1.0)),
    "clusters on a line": _clusters(cloud(1, 700, 500, spread=1.0)),
    "every distance": _at_every_distance(cloud(2, 150, 3000, spread=0.5)),
    "half the weights zero": _zero_weights(cloud(2, 333, 100)),
    "one-hot": _one_hot(cloud(2, 200, 100)),
    "the heaviest far away": _far_from_the_heaviest(cloud(1, 200, 100)),
    "a wide cloud": cloud(2, 200, 100, spread=300.0),
    "a narrow cloud": cloud(2, 200, 100, spread=1e-6),
    "a shifted cloud": _shifted(cloud(2, 200, 100)),
    "an outlier of no weight": _one_outlier_of_no_weight(cloud(2, 200, 100)),
    "duplicates": _duplicates(cloud(2, 200, 100)),
    "unnormalised weights": _unnormalised(cloud(2, 200, 100)),
    "the edge of single precision": _at_the_edge_of_single_precision(cloud(2, 200, 2000)),
    "the same in four dimensions": _at_the_edge_of_single_precision(cloud(4, 200, 2000)),
}
LOG_TOLERANCE = {"float32": 1e-4, "float64": 1e-9, "twin": 1e-9}
every_adversary = pytest.mark.parametrize("case", ADVERSARIES.values(), ids=list(ADVERSARIES))
every_precision = pytest.mark.parametrize("precision", ["float32", "float64"])
every_variant = pytest.mark.parametrize("variant", ["float32", "float64", "twin"])


def sample(variant, *arguments, **options):
    if variant == "twin":
        return kernels.sample_histories_numpy(*arguments)
    return kernels.sample_histories(*arguments, precision=variant, **options)


@every_adversary
@every_variant
def test_log_mixture_is_exact_in_log_space(case, variant):
    expected = logsumexp(dense_log_terms(*case), axis=1)
    log_mixture, _ = sample(variant, *case, np.full(len(case[0]), 0.5))
    np.testing.assert_allclose(log_mixture, expected, rtol=1e-9, atol=LOG_TOLERANCE[variant])


@every_adversary
@every_precision
def test_density_alone_is_the_same(case, precision):
    log_mixture, _ = kernels.sample_histories(*case, np.zeros(len(case[0])), precision=precision)
    np.testing.assert_array_equal(kernels.log_mixture_density(*case, precision=precision), log_mixture)
    with kernels.use_numpy():
        np.testing.assert_array_equal(kernels.log_mixture_density(*case), kernels.log_mixture_density_numpy(*case))


@pytest.mark.parametrize(("precision", "digits"), [("float32", 2e-7), ("float64", 1e-15)])
def test_a_single_term_keeps_the_digits_of_its_precision(precision, digits):
    """One history at the centre: what is left is the error of the power of two and of its exponent."""
    x = np.linspace(0.0, 9.0, 5001)[:, None]
    log_density = kernels.log_mixture_density(x, [[0.0]], [0.0], [[1.0]], precision=precision)
    exponent = 0.5 * x[:, 0] ** 2
    assert (np.abs(log_density + exponent + 0.5 * np.log(2.0 * np.pi)) < digits * (2.0 + exponent)).all()


@pytest.mark.parametrize(
    "case", ["two dimensions", "a shifted cloud", "the edge of single precision", "the same in four dimensions"]
)
def test_single_precision_is_used_where_it_is_asked_for_and_enough(case):
    single, double = (kernels.log_mixture_density(*ADVERSARIES[case], precision=p) for p in ("float32", "float64"))
    assert (single != double).mean() > 0.5


def test_double_precision_is_used_where_single_is_not_enough():
    single, double = (
        kernels.log_mixture_density(*ADVERSARIES["all far away"], precision=p) for p in ("float32", "float64")
    )
    np.testing.assert_allclose(single, double, rtol=1e-15)


@every_adversary
@every_variant
def test_draws_invert_the_cumulative_shares(case, variant):
    log_terms = dense_log_terms(*case)
    shares = np.exp(log_terms - logsumexp(log_terms, axis=1, keepdims=True))
    cumulative = np.cumsum(shares, axis=1)
    rows = np.arange(len(shares))
    for uniforms in (np.random.default_rng(1).random(len(rows)), np.zeros(len(rows)), np.full(len(rows), NEARLY_ONE)):
        _, ancestors = sample(variant, *case, uniforms)
        assert ancestors.dtype == np.int64
        assert (shares[rows, ancestors] > 0.0).all()
        above = cumulative[rows, ancestors]
        below = above - shares[rows, ancestors]
        slack = LOG_TOLERANCE[variant]
        assert (below <= uniforms + slack).all() and (uniforms <= above + slack).all()


@every_variant
def test_draws_follow_their_distribution(variant):
    innovations, means, log_weights, covariance = cloud(2, 300, 1, seed=3, spread=1.0)
    shares = np.exp(dense_log_terms(innovations, means, log_weights, covariance)[0])
    shares /= shares.sum()
    count = 20_000
    for copies in (np.repeat(innovations, count, axis=0), np.repeat(innovations + 60.0, count, axis=0)):
        log_terms = dense_log_terms(copies[:1], means, log_weights, covariance)[0]
        shares = np.exp(log_terms - logsumexp(log_terms))
        _, ancestors = sample(variant, copies, means, log_weights, covariance, np.random.default_rng(4).random(count))
        counts = np.bincount(ancestors, minlength=len(shares))
        common = shares * count > 8.0
        observed = np.append(counts[common], counts[~common].sum())
        expected = np.append(shares[common], shares[~common].sum()) * count
        observed, expected = observed[expected > 5.0], expected[expected > 5.0]
        assert stats.chisquare(observed, expected * observed.sum() / expected.sum()).pvalue > 1e-4


@settings(max_examples=60)
@given(
    n=st.integers(1, 300),
    d=st.integers(1, 4),
    zeros=st.floats(0.0, 0.99),
    distance=st.sampled_from([0.0, 5.0, 20.0, 1e3, 1e9]),
    uniform=st.sampled_from([0.0, 0.3, NEARLY_ONE]),
    seed=st.integers(0, 2**32),
)
@every_precision
def test_zero_weights_are_never_drawn(precision, n, d, zeros, distance, uniform, seed):
    rng = np.random.default_rng(seed)
    means = rng.normal(size=(n, d))
    log_weights = np.where(rng.random(n) < zeros, -np.inf, 30.0 * rng.normal(size=n))
    log_weights[rng.integers(n)] = 0.0
    innovations = rng.normal(size=(20, d)) + distance
    log_mixture, ancestors = kernels.sample_histories(
        innovations, means, log_weights, np.eye(d), np.full(20, uniform), precision=precision
    )
    assert np.isfinite(log_mixture).all()
    assert (log_weights[ancestors] > -np.inf).all()


@every_variant
def test_the_likeliest_history_is_drawn_far_out(variant):
    """At 50 sigma one history is overwhelmingly the nearest, however small its weight."""
    means = np.array([[0.0, 0.0], [3.0, 0.0], [0.0, 2.0]])
    _, ancestors = sample(
        variant, np.full((3, 2), [50.0, 0.0]), means, np.log([0.6, 1e-9, 0.4]), np.eye(2), [1e-9, 0.5, NEARLY_ONE]
    )
    assert (ancestors == 1).all()


@every_variant
@pytest.mark.parametrize("n", [2, 16, 128, 1024])
def test_a_uniform_on_the_boundary_of_two_shares_draws_the_later(variant, n):
    """Equal terms are exact in any precision, and so are their sums."""
    _, ancestors = sample(variant, np.zeros((n, 2)), np.zeros((n, 2)), np.zeros(n), np.eye(2), np.arange(n) / n)
    np.testing.assert_array_equal(ancestors, np.arange(n))


@every_variant
def test_beyond_the_range_of_numbers_the_weights_alone_draw(variant):
    means, weights = np.zeros((4, 2)), np.array([0.0, 0.5, 0.2, 0.3])
    with np.errstate(divide="ignore"):
        log_weights = np.log(weights)
    innovations = np.array([[60.0, 0.0], [1e300, 0.0], [0.0, 0.0], [0.0, -1e200], [1e250, 1e250]])
    uniforms = [0.95, 0.1, 0.1, 0.6, 0.9]
    log_mixture, ancestors = sample(variant, innovations, means, log_weights, np.eye(2), uniforms)
    assert np.isneginf(log_mixture).tolist() == [False, True, False, True, True]
    assert ancestors.tolist() == [3, 1, 1, 2, 3]
    means = np.array([[1e250], [-1e250], [1e250], [-1e250]]) * np.ones(2)
    everywhere = sample(variant, innovations, means, log_weights, np.eye(2) * 1e-200, uniforms)
    assert np.isneginf(everywhere[0]).all() and everywhere[1].tolist() == [3, 1, 1, 2, 3]


@every_precision
def test_threads_and_company_do_not_change_a_row(precision):
    case = _some_far(cloud(2, 900, 1500))
    uniforms = np.random.default_rng(6).random(1500)
    log_mixture, ancestors = kernels.sample_histories(*case, uniforms, precision=precision)
    for threads in (2, 3):
        shared = kernels.sample_histories(*case, uniforms, precision=precision, threads=threads)
        np.testing.assert_array_equal(shared[0], log_mixture)
        np.testing.assert_array_equal(shared[1], ancestors)
    some = slice(700, 710)
    alone = kernels.sample_histories(case[0][some], *case[1:], uniforms[some], precision=precision)
    np.testing.assert_array_equal(alone[0], log_mixture[some])
    np.testing.assert_array_equal(alone[1], ancestors[some])


def test_many_threads_of_the_caller_agree():
    case, uniforms = cloud(2, 700, 700), np.random.default_rng(7).random(700)
    expected = kernels.sample_histories(*case, uniforms)
    results = []
    threads = [Thread(target=lambda: results.append(kernels.sample_histories(*case, uniforms))) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(results) == 4
    for log_mixture, ancestors in results:
        np.testing.assert_array_equal(log_mixture, expected[0])
        np.testing.assert_array_equal(ancestors, expected[1])


@every_variant
def test_no_innovations(variant):
    log_mixture, ancestors = sample(variant, np.empty((0, 2)), np.zeros((3, 2)), np.zeros(3), np.eye(2), [])
    assert log_mixture.shape == ancestors.shape == (0,)


GOOD = {
    "innovations": np.zeros((4, 2)),
    "means": np.zeros((3, 2)),
    "log_weights": np.zeros(3),
    "covariance": np.eye(2),
    "uniforms": np.zeros(4),
}


@pytest.mark.parametrize("function", [kernels.sample_histories, kernels.sample_histories_numpy])
@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"innovations": np.zeros(4)}, "innovations must have shape"),
        ({"innovations": np.full((4, 2), np.nan)}, "innovations must be finite"),
        ({"means": np.zeros((3, 1))}, r"means must have shape \(N, 2\)"),
        ({"means": np.zeros((0, 2)), "log_weights": np.zeros(0)}, r"means must have shape \(N, 2\)"),
        ({"means": np.full((3, 2), np.inf)}, "means must be finite"),
        ({"log_weights": np.zeros(4)}, r"log_weights must have shape \(3,\)"),
        ({"log_weights": np.full(3, -np.inf)}, "every weight is zero"),
        ({"log_weights": np.array([0.0, np.nan, 0.0])}, "log_weights must be numbers"),
        ({"log_weights": np.array([0.0, np.inf, 0.0])}, "log_weights must be numbers"),
        ({"covariance": np.eye(3)}, r"covariance must have shape \(2, 2\)"),
        ({"covariance": np.diag([1.0, -1.0])}, "positive definite"),
        ({"covariance": np.zeros((2, 2))}, "positive definite"),
        ({"covariance": np.array([[1.0, 0.5], [0.2, 1.0]])}, "symmetric"),
        ({"covariance": np.full((2, 2), np.nan)}, "covariance must be finite"),
        ({"uniforms": np.zeros(3)}, r"uniforms must have shape \(4,\)"),
        ({"uniforms": np.array([0.0, 0.5, 1.0, 0.0])}, r"uniforms must lie in \[0, 1\)"),
        ({"uniforms": np.array([0.0, -0.1, 0.9, 0.0])}, r"uniforms must lie in \[0, 1\)"),
        ({"precision": "float16"}, "precision must be"),
    ],
)
def test_bad_histories_are_named(function, changed, message):
    with pytest.raises(ValueError, match=message):
        function(**{**GOOD, **changed})


# --- contour scan ---------------------------------------------------------------------------------------------


def oracle_offsets(edges, transforms, points, normals, reach):
    """Pixel by pixel, through the inverse of each transform."""
    height, width = edges.shape
    offsets = np.full((len(transforms), len(points)), reach + 1)
    order = sorted(range(-reach, reach + 1), key=lambda s: (abs(s), -s))
    for n, transform in enumerate(transforms):
        inverse = np.linalg.inv(transform[:, :2])
        for l, (point, normal) in enumerate(zip(points, normals, strict=True)):
            centre = transform[:, :2] @ point + transform[:, 2]
            across = inverse.T @ normal
            across /= np.linalg.norm(across)
            for s in order:
                x, y = np.floor(centre + s * across + 0.5).astype(int)
                if 0 <= x < width and 0 <= y < height and edges[y, x]:
                    offsets[n, l] = s
                    break
    return offsets


def random_scan(seed, particles=40, reflect=True):
    rng = np.random.default_rng(seed)
    edges = rng.random((37, 53)) < 0.04
    transforms = np.concatenate([rng.normal(size=(particles, 2, 2)), np.zeros((particles, 2, 1))], axis=2)
    if not reflect:
        transforms[:, 0, :2] *= np.sign(np.linalg.det(transforms[:, :, :2]))[:, None]
    transforms[:, :, 2] = rng.uniform(-15.0, [68.0, 52.0], (particles, 2))
    points = rng.normal(size=(6, 2)) * 4.0
    return edges, transforms, points, rng.normal(size=(6, 2))


@pytest.mark.parametrize("seed", range(5))
def test_offsets_are_those_of_a_plain_search(seed):
    edges, transforms, points, normals = random_scan(seed)
    offsets = kernels.scan_offsets_numpy(edges, transforms, points, normals, 8)
    np.testing.assert_array_equal(offsets, oracle_offsets(edges, transforms, points, normals, 8))


@pytest.mark.parametrize("reach", [0, 1, 5, 12])
def test_each_point_costs_what_its_offset_says(reach):
    """With one point and costs 0, 1, 2, ... the scan returns the distance itself: no rounding hides a difference."""
    edges, transforms, points, normals = random_scan(11, particles=2000)
    offsets = kernels.scan_offsets_numpy(edges, transforms, points, normals, reach)
    for l in range(len(points)):
        arguments = (edges, transforms, points[l : l + 1], normals[l : l + 1], np.arange(reach + 2.0))
        np.testing.assert_array_equal(kernels.scan_contours(*arguments), np.abs(offsets[:, l]))
        np.testing.assert_array_equal(kernels.scan_contours_numpy(*arguments), np.abs(offsets[:, l]))


def test_costs_are_summed_over_the_contour():
    edges, transforms, points, normals = random_scan(12, particles=300)
    cost = np.random.default_rng(0).normal(size=9)
    offsets = kernels.scan_offsets_numpy(edges, transforms, points, normals, 7)
    for scan in (kernels.scan_contours, kernels.scan_contours_numpy):
        np.testing.assert_allclose(
            scan(edges, transforms, points, normals, cost), cost[np.abs(offsets)].sum(axis=1), atol=1e-12
        )


IDENTITY = np.array([[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]])
both_scans = pytest.mark.parametrize("scan", [kernels.scan_contours, kernels.scan_contours_numpy])


def test_the_sign_is_that_of_the_normal_and_ties_go_ahead():
    edges = np.zeros((20, 30), dtype=bool)
    edges[10, 13] = edges[10, 21] = True
    centres = [[12.4, 10.0], [17.0, 10.0], [19.0, 10.2], [25.0, 10.0], [17.0, 11.0]]
    for normal, expected in (([1.0, 0.0], [1, 4, 2, -4, 5]), ([-3.0, 0.0], [-1, 4, -2, 4, 5])):
        offsets = kernels.scan_offsets_numpy(edges, IDENTITY, centres, [normal] * 5, 4)
        np.testing.assert_array_equal(offsets, [expected])


def test_halves_round_up():
    edges = np.zeros((4, 9), dtype=bool)
    edges[1, 5] = True
    centres = [[4.49, 1.0], [4.5, 1.0], [5.49, 1.0], [5.5, 1.0], [5.0, 0.5], [5.0, 1.5]]
    offsets = kernels.scan_offsets_numpy(edges, IDENTITY, centres, [[1.0, 0.0]] * 6, 0)
    np.testing.assert_array_equal(offsets, [[1, 0, 0, 1, 0, 1]])


@both_scans
def test_normals_stay_across_the_contour_when_it_is_sheared_or_mirrored(scan):
    """Under any transform a line stays on its edges, and a scan along its normals finds them at the same distance."""
    t = np.linspace(-6.0, 6.0, 13)
    points, normals = np.stack([t, np.zeros(13)], axis=1), np.tile([0.0, 2.5], (13, 1))
    edges = np.zeros((60, 60), dtype=bool)
    edges[np.arange(60), np.arange(60)] = True
    diagonal = np.array([1.0, 1.0]) / np.sqrt(2.0)
    for across in ([1.0, -1.0], [-1.0, 1.0], [1.0, -0.2], [-3.0, 0.0]):
        matrix = np.column_stack([diagonal, across])
        for s in (0.0, 3.0):
            away = np.array([30.0, 30.0]) + s * np.array([1.0, -1.0]) / np.sqrt(2.0)
            transform = np.column_stack([matrix, away])[None]
            distance = scan(edges, transform, points, normals, np.arange(12.0)) / 13.0
            np.testing.assert_allclose(distance, s, atol=0.5)


@both_scans
def test_strange_transforms_have_likelihood_zero_and_nothing_crashes(scan):
    edges = np.ones((20, 20), dtype=bool)
    points, normals, cost = np.ones((3, 2)), np.ones((3, 2)), np.arange(6.0)
    sound = np.array([[1.0, 0.0, 5.0], [0.0, 1.0, 5.0]])
    strange = []
    for row, column, value in [(0, 2, np.nan), (1, 2, np.inf), (0, 0, np.nan), (1, 1, -np.inf), (0, 2, -np.inf)]:
        strange.append(sound.copy())
        strange[-1][row, column] = value
    strange += [sound * [0.0, 0.0, 1.0], sound * [1e-200, 1e-200, 1.0], sound * [1e200, 1e200, 1.0]]
    strange += [np.array([[1.0, 2.0, 5.0], [2.0, 4.0, 5.0]])]
    result = scan(edges, np.array([sound, *strange, sound]), points, normals, cost)
    np.testing.assert_array_equal(result[[0, -1]], 0.0)
    assert np.isneginf(result[1:-1]).all()


@both_scans
@pytest.mark.parametrize("away", [1e3, 1e6, 1e15, 1e300])
def test_particles_far_away_see_nothing(scan, away):
    edges = np.ones((20, 20), dtype=bool)
    directions = np.array([[1, 0], [0, 1], [-1, 0], [0, -1], [1, 1], [-1, 1]]) * away
    transforms = np.concatenate([np.tile(np.eye(2), (6, 1, 1)), directions[:, :, None]], axis=2)
    result = scan(edges, transforms, np.zeros((2, 2)), np.ones((2, 2)), [0.0, 0.0, 0.0, -7.0])
    np.testing.assert_array_equal(result, -14.0)


@both_scans
def test_edges_are_seen_from_just_outside_and_no_further(scan):
    """All pixels around an image of edges, at every distance: the scan finds the border exactly within reach."""
    edges, reach = np.ones((6, 9), dtype=bool), 3
    for normal, axis, size in (([1.0, 0.0], 0, 9), ([0.0, 1.0], 1, 6)):
        for position in range(-9, size + 9):
            centre = [4.0, 3.0]
            centre[axis] = position
            distance = max(0, -position, position - size + 1)
            expected = min(distance, reach + 1)
            assert scan(edges, IDENTITY, [centre], [normal], np.arange(reach + 2.0)) == expected


def test_a_padded_map_serves_every_smaller_reach():
    edges, transforms, points, normals = random_scan(13, particles=200)
    padded = kernels.pad_edges(edges.astype(np.uint8) * 255, 9)
    for reach in (0, 4, 9):
        cost = np.linspace(0.0, -4.0, reach + 2)
        direct = kernels.scan_contours(edges, transforms, points, normals, cost)
        np.testing.assert_array_equal(kernels.scan_contours(padded, transforms, points, normals, cost), direct)


@both_scans
def test_an_edge_map_of_other_making_is_brought_to_the_kernel_or_refused(scan):
    edges = np.random.default_rng(3).random((20, 20)) < 0.2
    good = kernels.pad_edges(edges, 2)
    arguments = (np.tile(IDENTITY, (3, 1, 1)), [[4.0, 5.0], [11.0, 9.0]], np.ones((2, 2)), np.arange(4.0))
    other = kernels.EdgeMap(np.asfortranarray(good.padded.astype(float)), 2)
    np.testing.assert_array_equal(scan(other, *arguments), scan(good, *arguments))
    with pytest.raises(ValueError, match="padded must have shape"):
        kernels.EdgeMap(np.zeros(9), 2)


@both_scans
def test_a_cost_may_be_minus_infinity(scan):
    edges = np.zeros((5, 5))
    assert np.isneginf(scan(edges, IDENTITY, [[2.0, 2.0]], [[1.0, 0.0]], [0.0, -1.0, -np.inf]))


@both_scans
@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"edges": np.zeros(5)}, r"edges must have shape \(H, W\)"),
        ({"edges": kernels.pad_edges(np.zeros((5, 5)), 1)}, "padded for a reach of 1"),
        ({"transforms": np.zeros((4, 2, 2))}, r"transforms must have shape \(any, 2, 3\)"),
        ({"points": np.zeros((3, 3))}, r"points must have shape \(any, 2\)"),
        ({"points": np.full((3, 2), np.nan)}, "points must be finite"),
        ({"normals": np.zeros((3, 2))}, "not zero"),
        ({"normals": np.ones((2, 2))}, "normals must have shape"),
        ({"cost": [0.0]}, r"cost must have shape \(S \+ 2,\)"),
        ({"cost": [0.0, np.nan]}, "no NaN"),
    ],
)
def test_bad_scans_are_named(scan, changed, message):
    good = {
        "edges": np.zeros((5, 5)),
        "transforms": np.zeros((4, 2, 3)),
        "points": np.zeros((3, 2)),
        "normals": np.ones((3, 2)),
        "cost": np.zeros(5),
    }
    with pytest.raises(ValueError, match=message):
        scan(**{**good, **changed})


def test_a_negative_reach_is_named():
    with pytest.raises(ValueError, match="reach must be at least 0"):
        kernels.pad_edges(np.zeros((5, 5)), -1)


# --- propagation ----------------------------------------------------------------------------------------------


def compiled_normals(seed, count, dimension=1):
    """The generator alone: no dynamics, unit noise."""
    states = np.zeros((count, 1, dimension))
    still = np.zeros((1, dimension, dimension))
    return kernels.propagate(states, None, still, np.zeros(dimension), np.eye(dimension), seed)[:, 0]


@pytest.fixture(scope="module")
def a_million_normals():
    return compiled_normals(20, 1_000_000)[:, 0]


def test_normals_are_normal(a_million_normals):
    assert stats.kstest(a_million_normals, "norm").pvalue > 1e-4


def test_normals_have_the_moments_of_a_normal(a_million_normals):
    n = len(a_million_normals)
    for order, moment in ((1, 0.0), (2, 1.0), (3, 0.0), (4, 3.0), (5, 0.0), (6, 15.0), (8, 105.0)):
        powers = a_million_normals**order
        assert abs(powers.mean() - moment) < 4.5 * powers.std() / np.sqrt(n)


def test_normals_have_the_tails_of_a_normal(a_million_normals):
    bounds = np.concatenate([[-np.inf], np.arange(-4.2, -2.0, 0.2), np.arange(2.0, 4.3, 0.2), [np.inf]])
    observed = np.histogram(a_million_normals, bounds)[0]
    expected = np.diff(stats.norm.cdf(bounds)) * len(a_million_normals)
    assert expected.min() > 5.0
    assert stats.chisquare(observed, expected * observed.sum() / expected.sum()).pvalue > 1e-4


@pytest.mark.parametrize("lag", [1, 2, 3, 64, 127, 128, 129, 256, 1000])
def test_normals_at_a_distance_are_uncorrelated(a_million_normals, lag):
    """128 is the distance between the two normals of a pair, 256 that between blocks; squares show shared radii."""
    for values in (a_million_normals, a_million_normals**2 - 1.0, np.abs(a_million_normals) - np.sqrt(2.0 / np.pi)):
        products = values[lag:] * values[:-lag]
        assert abs(products.mean()) < 4.5 * products.std() / np.sqrt(len(products))


@pytest.mark.parametrize("other", [21, 0, 2**63, 2**64 - 1, 20 + 2**32])
def test_seeds_give_unrelated_streams(a_million_normals, other):
    different = compiled_normals(other, 200_000)[:, 0]
    here = a_million_normals[: len(different)]
    for shift in (0, 1, 2):
        products = here[shift:] * different[: len(different) - shift]
        assert abs(products.mean()) < 4.5 / np.sqrt(len(products))


def test_components_are_independent():
    normals = compiled_normals(5, 200_000, dimension=3)
    covariance = normals.T @ normals / len(normals)
    assert np.abs((covariance - np.eye(3)) * np.sqrt(len(normals) / 2.0)).max() < 4.5


@pytest.mark.parametrize(("count", "dimension"), [(1, 1), (5, 2), (255, 3), (256, 1), (257, 2), (1000, 4)])
@pytest.mark.parametrize("seed", [0, 1, 2**64 - 1])
def test_the_twin_draws_the_same_normals(count, dimension, seed):
    twin = kernels.standard_normals_numpy(seed, count, dimension)
    assert twin.shape == (count, dimension)
    np.testing.assert_allclose(compiled_normals(seed, count, dimension), twin, atol=1e-10)


MOTIONS = {(p, k): np.random.default_rng([p, k]) for p in (1, 2, 3) for k in (1, 2, 4)}


@pytest.mark.parametrize("shape", MOTIONS, ids=str)
@pytest.mark.parametrize("propagate", [kernels.propagate, kernels.propagate_numpy])
def test_new_states_follow_the_recursion(shape, propagate):
    p, k = shape
    rng = np.random.default_rng([p, k])
    states = rng.normal(size=(700, p, k))
    ancestors = rng.integers(0, 700, 900)
    coefficients, mean, factor = rng.normal(size=(p, k, k)), rng.normal(size=k), rng.normal(size=(k, k))
    new = propagate(states, ancestors, coefficients, mean, factor, 77)
    normals = kernels.standard_normals_numpy(77, 900, k)
    assert new.shape == (900, p, k)
    for i in (0, 1, 255, 256, 600, 899):
        parent = states[ancestors[i]]
        expected = mean + factor @ normals[i]
        for j in range(p):
            expected = expected + coefficients[j] @ (parent[j] - mean)
        np.testing.assert_allclose(new[i, 0], expected, atol=1e-9)
        np.testing.assert_array_equal(new[i, 1:], parent[:-1])
    np.testing.assert_allclose(
        new, kernels.propagate_numpy(states, ancestors, coefficients, mean, factor, 77), atol=1e-9
    )


def test_noise_has_the_covariance_of_its_factor():
    factor = np.array([[2.0, 0.0], [-1.5, 0.5]])
    noise = kernels.propagate(np.zeros((200_000, 1, 2)), None, np.zeros((1, 2, 2)), np.zeros(2), factor, 9)[:, 0]
    products = noise[:, :, None] * noise[:, None, :]
    z = (products.mean(axis=0) - factor @ factor.T) / (products.std(axis=0) / np.sqrt(len(noise)))
    assert np.abs(z).max() < 4.5


@pytest.mark.parametrize("propagate", [kernels.propagate, kernels.propagate_numpy])
def test_equal_seeds_give_equal_bytes_and_everyone_continues_itself_by_default(propagate):
    states = np.random.default_rng(2).normal(size=(1000, 2, 2))
    model = ([np.eye(2) * 0.7, np.eye(2) * 0.2], [1.0, -1.0], np.eye(2))
    first = propagate(states, None, *model, 123)
    np.testing.assert_array_equal(propagate(states, None, *model, 123), first)
    np.testing.assert_array_equal(propagate(states, np.arange(1000), *model, 123), first)
    np.testing.assert_array_equal(propagate(states[:300], None, *model, 123), first[:300])
    assert (propagate(states, None, *model, 124) != first)[:, 0].all()


@pytest.mark.parametrize("propagate", [kernels.propagate, kernels.propagate_numpy])
@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"states": np.zeros((5, 2))}, "states must have shape"),
        ({"states": np.zeros((0, 1, 2))}, "states must have shape"),
        ({"ancestors": [0, 5]}, "ancestors must be from 0 to 4"),
        ({"ancestors": [-1, 2]}, "ancestors must be from 0 to 4"),
        ({"coefficients": np.zeros((2, 2, 2))}, r"coefficients must have shape \(1, 2, 2\)"),
        ({"mean": np.zeros(3)}, r"mean must have shape \(2\)"),
        ({"cholesky": np.zeros((3, 3))}, r"cholesky must have shape \(2, 2\)"),
        ({"seed": -1}, "seed must be from 0"),
        ({"seed": 2**64}, "seed must be from 0"),
    ],
)
def test_bad_propagations_are_named(propagate, changed, message):
    good = {
        "states": np.zeros((5, 1, 2)),
        "ancestors": None,
        "coefficients": np.zeros((1, 2, 2)),
        "mean": np.zeros(2),
        "cholesky": np.eye(2),
        "seed": 1,
    }
    with pytest.raises(ValueError, match=message):
        propagate(**{**good, **changed})


# --- weights --------------------------------------------------------------------------------------------------

both_normalisers = pytest.mark.parametrize(
    "normalise", [kernels.normalise_log_weights, kernels.normalise_log_weights_numpy]
)
both_systematics = pytest.mark.parametrize(
    "systematic", [kernels.systematic_ancestors, kernels.systematic_ancestors_numpy]
)


@both_normalisers
@pytest.mark.parametrize("n", [1, 2, 7, 8, 9, 1000])
@pytest.mark.parametrize("spread", [0.0, 1.0, 30.0, 400.0])
@pytest.mark.parametrize("shift", [0.0, -5000.0, 900.0])
def test_normalised_weights(normalise, n, spread, shift):
    raw = np.random.default_rng(n).normal(size=n) * spread + shift
    raw[1::3] = -np.inf
    result = normalise(raw)
    expected = raw - logsumexp(raw)
    np.testing.assert_allclose(result.log_weights, expected, rtol=1e-12, atol=1e-11)
    np.testing.assert_allclose(result.weights, np.exp(expected), rtol=1e-11, atol=1e-300)
    assert (result.weights[1::3] == 0.0).all()
    assert result.log_sum == pytest.approx(logsumexp(raw), rel=1e-13, abs=1e-12)
    assert result.effective_sample_size == pytest.approx(1.0 / np.sum(np.exp(2.0 * expected)), rel=1e-10)


@both_normalisers
def test_equal_weights_have_the_full_effective_sample_size(normalise):
    assert normalise(np.full(640, -3.0)).effective_sample_size == pytest.approx(640.0, rel=1e-13)


@both_normalisers
@pytest.mark.parametrize(
    ("log_weights", "message"),
    [
        ([-np.inf, -np.inf], "every weight is zero"),
        ([0.0, np.nan], "numbers or minus infinity"),
        ([0.0, np.inf], "numbers or minus infinity"),
        ([], "at least one"),
        ([[0.0]], r"log_weights must have shape \(any\)"),
    ],
)
def test_bad_log_weights_are_named(normalise, log_weights, message):
    with pytest.raises(ValueError, match=message):
        normalise(log_weights)


@both_systematics
@given(
    weights=st.lists(st.one_of(st.just(0.0), st.floats(1e-9, 1.0)), min_size=1, max_size=60).filter(any),
    offset=st.one_of(st.floats(0.0, NEARLY_ONE), st.sampled_from([0.0, NEARLY_ONE])),
    count=st.integers(1, 90),
)
def test_systematic_takes_floor_or_ceiling_of_the_expected_copies(systematic, weights, offset, count):
    weights = np.array(weights)
    ancestors = systematic(weights, offset, count)
    assert ancestors.dtype == np.int64 and ancestors.shape == (count,)
    assert (np.diff(ancestors) >= 0).all()
    assert (weights[ancestors] > 0.0).all()
    counts = np.bincount(ancestors, minlength=len(weights))
    assert np.abs(counts - count * weights / weights.sum()).max() < 1.0 + 1e-9


@both_systematics
def test_systematic_points_fall_where_they_should(systematic):
    np.testing.assert_array_equal(systematic([0.25, 0.5, 0.25], 0.4, 4), [0, 1, 1, 2])
    np.testing.assert_array_equal(systematic([0.1, 0.0, 0.2, 0.7], 0.3), [0, 3, 3, 3])
    np.testing.assert_array_equal(systematic([0.1, 0.0, 0.2, 0.7], 0.5), [2, 3, 3, 3])
    np.testing.assert_array_equal(systematic([0.0, 3.0, 0.0], 0.0), [1, 1, 1])
    np.testing.assert_array_equal(systematic([1.0, 1.0], 0.9, 1), [1])


@both_systematics
def test_systematic_survives_a_cumulative_sum_that_rounds_up_before_its_end(systematic):
    rng = np.random.default_rng(9)
    for count in range(1, 120):
        weights = np.append(rng.random(5), 1e-300)
        ancestors = systematic(weights, 0.0, count)
        assert ancestors.shape == (count,) and ancestors[0] == 0


def test_systematic_writes_nowhere_else(compiled_module):
    """The last particle's share begins after the last point: its mark would fall outside."""
    buffer = np.full(6, -7)
    weights = _read_only(np.array([1.0, 1.0, 1e-3]))
    assert compiled_module.systematic_ancestors(weights, 0.1, buffer[1:5])
    np.testing.assert_array_equal(buffer, [-7, 0, 0, 1, 1, -7])


def test_systematic_twins_agree():
    rng = np.random.default_rng(8)
    for n in (10, 500, 20_000):
        weights = rng.dirichlet(np.full(n, 0.3))
        for count in (n // 2, n, 3 * n):
            offset = rng.random()
            np.testing.assert_array_equal(
                kernels.systematic_ancestors(weights, offset, count),
                kernels.systematic_ancestors_numpy(weights, offset, count),
            )


@both_systematics
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([0.0, 0.0], 0.5), "not all zero"),
        (([0.9, -0.1, 0.5], 0.5), "not negative"),
        (([0.5, np.nan], 0.5), "finite"),
        (([0.5, np.inf], 0.5), "finite"),
        (([1e-320, 0.0], 0.5), "not all zero or almost"),
        (([], 0.5), "at least one"),
        (([], 0.5, 3), "not all zero"),
        (([1.0], 1.0), "offset must lie"),
        (([1.0], 0.5, 0), "at least one"),
    ],
)
def test_bad_systematic_arguments_are_named(systematic, arguments, message):
    with pytest.raises(ValueError, match=message):
        systematic(*arguments)


def test_where_arrays_lie_in_memory_does_not_change_a_digit(compiled_module):
    n, buffer = 12, np.empty(400)
    log_weights = np.log(np.random.default_rng(0).random(n))
    found = set()
    for places in ((0, 12, 24), (24, 12, 0), (12, 0, 24), (0, 100, 200), (200, 14, 100)):
        given, normalised, weights = (buffer[place : place + n] for place in places)
        given[:] = log_weights
        sums = compiled_module.normalise_log_weights(given, log_weights.max(), normalised, weights)
        found.add((*sums, normalised.tobytes(), weights.tobytes()))
    assert len(found) == 1
