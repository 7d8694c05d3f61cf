"""The names that scripts need, loaded when they are asked for."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import pfviz

SRC = Path(__file__).resolve().parents[1] / "src"


@pytest.mark.parametrize("name", sorted(set(pfviz.__all__) - {"show"}))
def test_public_names_lead_to_the_objects_of_their_modules(name):
    value = getattr(pfviz, name)
    assert name in dir(pfviz)
    assert name.isupper() or value.__name__ == name


def test_every_public_name_has_a_home():
    assert set(pfviz.__all__) == {*pfviz._HOME, "show"}


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        pfviz.nothing  # noqa: B018


def test_importing_the_package_loads_nothing_else():
    program = f"import sys; sys.path.insert(0, {str(SRC)!r}); import pfviz; print('numpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_a_filter_in_a_world_of_ones_own():
    model = pfviz.ToyModel(
        pfviz.Autoregression.scalar([0.9], noise=0.2),
        pfviz.GaussianObservation(0.1 * np.eye(1)),
        pfviz.Detector(0.4, np.zeros((1, 1)), np.ones(1)),
        pfviz.Gaussian(np.zeros(1), np.eye(1)),
    )
    world = pfviz.World("mine", "Mine", "What to look for.", model, extent=3.0, n_particles=200)
    observations = world.record(0, 20).observations
    records = list(pfviz.run(pfviz.make_filter("rb-hs-sir", 200), model, observations))
    exact = pfviz.kalman_filter(model.dynamics, 0.1 * np.eye(1), model.prior, np.array(observations))
    distances = [pfviz.total_variation(r.posterior, k.posterior) for r, k in zip(records, exact, strict=True)]
    assert np.mean(distances) < 0.3
