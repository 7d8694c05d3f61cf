"""Which of two channels is steeper: compiled and plain, against a loop over pixels."""

from __future__ import annotations

import numpy as np
import pytest

from pfviz.kernels import steepest, steepest_numpy

both = pytest.mark.parametrize("function", [steepest, steepest_numpy])


@both
@pytest.mark.parametrize("reach", [3, 1020, 32767])
def test_the_steeper_channel_is_taken_and_the_first_of_equal_ones(function, reach):
    dx, dy = np.random.default_rng(reach).integers(-reach, reach + 1, (2, 13, 21, 2)).astype(np.int16)
    dx[4:, 5], dy[4:, 5] = [[3, -5]], [[-4, 0]]
    across, down = function(dx, dy)
    assert across.dtype == down.dtype == np.int16
    for place in np.ndindex(13, 21):
        (p0, p1), (q0, q1) = dx[place].tolist(), dy[place].tolist()
        second = p1**2 + q1**2 > p0**2 + q0**2
        assert (across[place], down[place]) == ((p1, q1) if second else (p0, q0))


@both
def test_bad_gradients_are_named(function):
    with pytest.raises(ValueError, match="dx must have shape"):
        function(np.zeros((4, 5, 3)), np.zeros((4, 5, 3)))
    with pytest.raises(ValueError, match="dy must have shape"):
        function(np.zeros((4, 5, 2)), np.zeros((4, 6, 2)))
