"""A gallery of situations, each of which shows one thing that particle filters do.

Every one is a comparison: a filter that suffers and a rival that does not, on the same data and random numbers. What
the sentences claim is tested as statistics over many seeds.
"""

from __future__ import annotations

from dataclasses import dataclass

from pfviz.names import find
from pfviz_app.settings import Settings


@dataclass(frozen=True, slots=True)
class Scenario:
    """One situation.

    Attributes:
        name: short, for links.
        title: on the screen.
        look_for: one sentence on what to look for.
        settings: world, filter, rival, particles, noises and seed.
        t: the time to go to, None for the beginning.
    """

    name: str
    title: str
    look_for: str
    settings: Settings
    t: int | None = None


def _toy(world: str, filter_name: str, rival: str, particles: int, seed: int, system: float = 1.0) -> Settings:
    """Settings with the toy alone on screen; the video, unseen, runs with few particles."""
    return Settings(
        world=world,
        filter=filter_name,
        rival=rival,
        toy_particles=particles,
        tracker_particles=100,
        seed=seed,
        system=system,
        pane="toy",
    )


_ALL = (
    Scenario(
        "arbitrary-associations",
        "Arbitrary associations",
        "Basic-SIR joins innovation i to history i, whatever they are: most orange arrows could not have happened, and "
        "ESS is a third of what it is when every innovation samples its history.",
        _toy("figure-1", "basic-sir", "rb-hs-sir", 24, seed=1),
        t=8,
    ),
    Scenario(
        "degenerate-weights",
        "Degenerate weights",
        "Under half the system noise even fewer pairs are possible: in three steps of four one particle of Basic-SIR "
        "has more than half of all the weight. Click it to see its receipt.",
        _toy("figure-1", "basic-sir", "rb-hs-sir", 24, seed=3, system=0.5),
        t=8,
    ),
    Scenario(
        "peaked-likelihood",
        "A peaked likelihood",
        "The observation is sharper than what the dynamics or the detector propose: of 100 particles of CONDENSATION 5 "
        "count. RB-HS-SIR does no better here; LS-HS-SIR, which searches the likelihood first, keeps twice as many.",
        _toy("peaked", "condensation", "ls-hs-sir", 100, seed=8),
        t=8,
    ),
    Scenario(
        "wrong-noise",
        "Too little noise believed",
        "The target moves three times as wildly as the filters believe: CONDENSATION lags behind at every turn, "
        "RB-HS-SIR has particles where the detector points. Noise taken for too large costs both alike.",
        _toy("wrong-noise", "condensation", "rb-hs-sir", 30, seed=5),
        t=20,
    ),
    Scenario(
        "look-alike",
        "A look-alike",
        "Half of the proposals lie on something that looks the same, and only the history tells which is which: "
        "Basic-SIR wastes the good ones on wrong histories as well, and follows the wrong object more often.",
        _toy("plane", "basic-sir", "rb-hs-sir", 50, seed=5),
        t=14,
    ),
    Scenario(
        "occlusion",
        "Occlusion",
        "For twelve steps nothing was seen, and the cloud has grown as the exact posterior has. Step on: of "
        "CONDENSATION's particles hardly any is where the target comes back, the detector's all are.",
        _toy("occlusion", "condensation", "rb-hs-sir", 30, seed=1),
        t=62,
    ),
    Scenario(
        "jump",
        "A jump, and recovery",
        "At step 25 the target is put elsewhere: CONDENSATION has nobody there and needs five steps to come back, "
        "RB-HS-SIR one. The exact posterior of a model that excludes jumps is slow as well.",
        _toy("recovery", "condensation", "rb-hs-sir", 50, seed=4),
        t=24,
    ),
    Scenario(
        "dying-modes",
        "Modes die out",
        "Two modes that should weigh the same for ever: resampling lets one of them die by chance, in CONDENSATION "
        "more often than where the detector goes on proposing both. The mean says nothing of it.",
        _toy("two-modes", "condensation", "rb-hs-sir", 50, seed=4),
        t=30,
    ),
    Scenario(
        "icondensation-bias",
        "A bias that more particles do not cure",
        "A thousand particles, and ICondensation's cloud still has twice the variance of the exact posterior (black): "
        "arbitrary pairs have the weight of sampled ones. RB-HS-SIR is close to it.",
        _toy("figure-1", "icondensation", "rb-hs-sir", 1000, seed=0),
        t=8,
    ),
)
SCENARIOS: dict[str, Scenario] = {scenario.name: scenario for scenario in _ALL}


def find_scenario(name: str) -> Scenario:
    """The situation called ``name``.

    Raises:
        UnknownName: if there is none; the message suggests the nearest.
    """
    return find(SCENARIOS, name, "scenario")
