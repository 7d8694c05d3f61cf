"""Filters by name, and settings out of range."""

import pytest

from pfviz.filters import FILTERS, FilterError, make_filter
from pfviz.names import UnknownName


@pytest.mark.parametrize("name", FILTERS)
def test_every_filter_is_made_by_its_name(name):
    assert make_filter(name, 7).n_particles == 7  # type: ignore[attr-defined]
    assert FILTERS[name].name == name
    assert FILTERS[name].make.__doc__


@pytest.mark.parametrize("n_particles", [0, -3, 1.5, "ten", None, True])
@pytest.mark.parametrize("name", FILTERS)
def test_the_number_of_particles_is_checked(name, n_particles):
    with pytest.raises(FilterError, match="n_particles must be a whole number of at least 1, got"):
        make_filter(name, n_particles)


def test_the_nearest_filter_is_suggested():
    with pytest.raises(UnknownName, match="did you mean 'rb-hs-sir'"):
        make_filter("rb-hs-sri")


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"resampling": "roulette"}, "resampling must be one of multinomial, .*, got 'roulette'"),
        ({"ess_threshold": 1.5}, "ess_threshold must be between 0 and 1, got 1.5"),
        ({"ess_threshold": -0.1}, "ess_threshold must be between 0 and 1, got -0.1"),
        ({"ess_threshold": float("nan")}, "ess_threshold must be between 0 and 1, got nan"),
        ({"ess_threshold": "half"}, "ess_threshold must be between 0 and 1, got 'half'"),
    ],
)
@pytest.mark.parametrize("name", ["condensation", "basic-sir"])
def test_resampling_settings_are_checked(name, settings, message):
    with pytest.raises(FilterError, match=message):
        make_filter(name, 10, **settings)
