"""The exact posterior beside a run of a toy world."""

from __future__ import annotations

from typing import Any

from pfviz.exact import Gaussian, GridDensity, GridMarginal
from pfviz.particles import FloatArray

_KEPT_STATES = 32
Known = tuple[Gaussian | GridDensity, tuple[Gaussian | GridMarginal, float]]
"""The exact posterior of the state, that of the innovation, and the increment of log p(y_1:t)."""


class ExactAnswer:
    """The exact posterior of a toy world, followed step by step under the model that the filter believes in.

    The densities on a grid are large. Only the latest are kept; one that is needed again is worked out again.
    """

    def __init__(self, dimension: int, prior: Gaussian) -> None:
        self._dimension, self._prior = dimension, prior
        self._states: dict[int, Gaussian | GridDensity] = {0: prior}
        self._seen: dict[int, tuple[Any, FloatArray]] = {}
        self._answers: dict[int, tuple[Gaussian | GridMarginal, float]] = {}

    def step(self, t: int, model: Any, observation: FloatArray, known: Known | None = None) -> Known | None:
        """Go on to time ``t`` and say what is found there; None where nothing is. What came later is forgotten.

        Args:
            t: the time.
            model: believed in.
            observation: at that time.
            known: what another answer to the same course has found there, to be spared the work.
        """
        self.rewind(t - 1)
        self._seen[t] = (model, observation)
        if known is not None:
            self._states[t], self._answers[t] = known
        else:
            self._work_out(t)
        for old in sorted(self._states)[1:-_KEPT_STATES]:
            del self._states[old]
        return (self._states[t], self._answers[t]) if t in self._answers else None

    def _work_out(self, t: int) -> None:
        for time in range(max(self._states) + 1, t + 1):
            believed, seen = self._seen[time]
            step = believed.exact_step(self._states[time - 1], seen)
            if step is None:
                return
            self._states[time] = step.posterior
            marginal = step.posterior.leading(1 if isinstance(step.posterior, GridDensity) else self._dimension)
            self._answers[time] = (marginal, step.log_evidence)

    def rewind(self, t: int) -> None:
        """Forget what came after time ``t``."""
        for kept in (self._states, self._seen, self._answers):
            while kept and next(reversed(kept)) > t:
                kept.popitem()

    def copy(self) -> ExactAnswer:
        """One that goes its own way from here."""
        other = ExactAnswer(self._dimension, self._prior)
        other._states, other._seen, other._answers = dict(self._states), dict(self._seen), dict(self._answers)
        return other

    def marginal(self, t: int) -> Gaussian | GridMarginal | None:
        """The exact posterior of the innovation at time ``t``, where there is one."""
        return self._answers[t][0] if t in self._answers else None

    def log_evidence(self, t: int) -> float:
        """The exact increment of log p(y_1:t); NaN where there is none."""
        return self._answers[t][1] if t in self._answers else float("nan")
