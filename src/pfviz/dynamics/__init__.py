"""How states evolve."""

from pfviz.dynamics.autoregressive import Autoregression

__all__ = ["Autoregression"]
