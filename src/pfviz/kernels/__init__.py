"""The hot loops, each compiled with numba beside a plain NumPy twin.

Every function ``f`` here takes plain arrays, has no side effects, and has a twin ``f_numpy`` that computes
the same in plain NumPy: the oracle of the tests, and what runs without numba.

Which of the two runs is the *backend*:

- ``"numba"`` is the default. The first call compiles all kernels at once and blocks until they are ready:
  ten to twenty seconds the first time on a machine, a third of a second in each process thereafter, from numba's
  disk cache. A cache folder that cannot be written to costs only the time. ``warm_up()`` does this ahead of
  need, in whatever thread calls it; ``compiled_ready()`` tells whether it is done.
- ``"numpy"`` runs the twins: where numba cannot be imported, in a process started with ``PFVIZ_NO_NUMBA=1``,
  and inside a ``with use_numpy():`` block, for the thread that entered it.

The backend never changes by itself: a run does not begin on the twins and go over to the compiled kernels
when they are ready. The two agree but for the last digits, so a draw may fall on the other side of a boundary
and a film go another way. *Equal seeds give equal bytes on one backend, one machine and one version of the
libraries.* A program that must not wait can start ``warm_up`` in a thread and hold ``use_numpy()`` around a
whole run, until its next reset.

Importing this package imports neither numba nor any other module of pfviz.
"""

from pfviz.kernels.backend import Backend, backend, compiled_ready, use_numpy, warm_up
from pfviz.kernels.contours import (
    EdgeMap,
    pad_edges,
    scan_contours,
    scan_contours_numpy,
    scan_offsets_numpy,
)
from pfviz.kernels.gradients import steepest, steepest_numpy
from pfviz.kernels.histories import (
    Precision,
    log_mixture_density,
    log_mixture_density_numpy,
    sample_histories,
    sample_histories_numpy,
)
from pfviz.kernels.propagation import propagate, propagate_numpy, standard_normals_numpy
from pfviz.kernels.regions import (
    NO_BIN,
    normalised,
    patch_correlations,
    patch_correlations_numpy,
    patch_values,
    region_affinities,
    region_affinities_numpy,
    weighted_sums,
    weighted_sums_numpy,
)
from pfviz.kernels.weights import (
    NormalisedWeights,
    normalise_log_weights,
    normalise_log_weights_numpy,
    systematic_ancestors,
    systematic_ancestors_numpy,
)

__all__ = [
    "NO_BIN",
    "Backend",
    "EdgeMap",
    "NormalisedWeights",
    "Precision",
    "backend",
    "compiled_ready",
    "log_mixture_density",
    "log_mixture_density_numpy",
    "normalise_log_weights",
    "normalise_log_weights_numpy",
    "normalised",
    "pad_edges",
    "patch_correlations",
    "patch_correlations_numpy",
    "patch_values",
    "propagate",
    "propagate_numpy",
    "region_affinities",
    "region_affinities_numpy",
    "sample_histories",
    "sample_histories_numpy",
    "scan_contours",
    "scan_contours_numpy",
    "scan_offsets_numpy",
    "standard_normals_numpy",
    "steepest",
    "steepest_numpy",
    "systematic_ancestors",
    "systematic_ancestors_numpy",
    "use_numpy",
    "warm_up",
    "weighted_sums",
    "weighted_sums_numpy",
]
