"""Run two filters on the same world with the same random numbers, and look inside one step of each."""

import numpy as np

from pfviz.filters import make_filter
from pfviz.running import run
from pfviz.worlds import get_world

world = get_world("figure-1")
film = world.record(seed=0, steps=30)
for name in ("basic-sir", "rb-hs-sir"):
    records = list(run(make_filter(name, 24), world.model, film.observations, seed=0))
    sizes = [record.effective_sample_size for record in records]
    print(f"{name}: mean effective sample size {np.mean(sizes):.1f} of 24; the last step:")
    for stage in records[-1].stages:
        factors = ", ".join(f"{key} {np.exp(value).max():.3g}" for key, value in stage.log_factors.items())
        print(f"  {stage.kind:<10} {factors and 'largest factors: ' + factors}")
