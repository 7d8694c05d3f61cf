"""How states evolve."""

from pfviz.dynamics.autoregressive import Autoregression
from pfviz.dynamics.learning import FittedDynamics, fit_dynamics, learn_dynamics, read_states

__all__ = ["Autoregression", "FittedDynamics", "fit_dynamics", "learn_dynamics", "read_states"]
