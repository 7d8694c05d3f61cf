"""A world is data: write one, and check a filter on it against the Kalman filter."""

import numpy as np

from pfviz.dynamics import Autoregression
from pfviz.exact import Gaussian, kalman_filter
from pfviz.filters import make_filter
from pfviz.observations import GaussianObservation
from pfviz.running import run
from pfviz.worlds import Detector, ToyModel, World

dynamics = Autoregression.scalar([1.6, -0.64], noise=0.2)
model = ToyModel(
    dynamics,
    GaussianObservation(np.array([[0.09]])),
    Detector(width=0.5, offsets=np.zeros((1, 1)), weights=np.ones(1)),
    Gaussian(np.zeros(2), dynamics.stationary_covariance()),
)
world = World("mine", "A world of my own", "Does it agree with Kalman?", model, extent=4.0, n_particles=200)

film = world.record(seed=1, steps=40)
exact = kalman_filter(dynamics, np.array([[0.09]]), model.prior, np.array(film.observations))
records = list(run(make_filter("rb-hs-sir", 2000), model, film.observations, seed=1))
for t in (9, 19, 29, 39):
    print(f"t = {t + 1}: particle mean {records[t].estimate[0]:+.3f}, exact {exact[t].posterior.mean[0]:+.3f}")
