"""Random numbers that can be replayed, one independent stream for each purpose within a step.

A step at time t draws from ``step_rng(seed, t)``, so any step can be replayed alone. Inside the step every purpose has
a stream of its own, so two filters run in lock-step on the same seed share their proposal draws even when one of them
resamples and the other does not.
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np

Purpose = Literal["prior", "resample", "predict", "propose", "associate", "complete", "choose", "search"]
_PURPOSES: tuple[str, ...] = get_args(Purpose)


def step_rng(seed: int, t: int) -> np.random.Generator:
    """The generator of the step at time ``t`` in the run with ``seed``; time 0 is the initialisation."""
    return np.random.default_rng([seed, t])


class Streams:
    """Independent generators, one a purpose, all derived from one generator.

    Making two ``Streams`` from one generator gives different streams; making one from each of two equally seeded
    generators gives equal streams.
    """

    __slots__ = ("_root",)

    def __init__(self, rng: np.random.Generator) -> None:
        seed_sequence = rng.bit_generator.seed_seq
        if not isinstance(seed_sequence, np.random.SeedSequence):
            seed_sequence = np.random.SeedSequence(rng.integers(2**63, size=4))
        self._root = seed_sequence.spawn(1)[0]

    def _child(self, purpose: Purpose) -> np.random.SeedSequence:
        key = (*self._root.spawn_key, _PURPOSES.index(purpose))
        return np.random.SeedSequence(self._root.entropy, spawn_key=key)

    def of(self, purpose: Purpose) -> np.random.Generator:
        """The generator of ``purpose``, at its beginning."""
        return np.random.Generator(np.random.PCG64(self._child(purpose)))

    def seed(self, purpose: Purpose) -> int:
        """A 64-bit seed for a compiled generator of ``purpose``."""
        return int(self._child(purpose).generate_state(1, np.uint64)[0])
