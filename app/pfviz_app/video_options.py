"""What the options of ``pfviz track`` and ``pfviz serve`` say about a video and the object in it."""

from __future__ import annotations

import argparse
import csv

from pfviz.dynamics import Autoregression, learn_dynamics, read_states
from pfviz.vision.limits import Limits, display_name
from pfviz.vision.motion import DEFAULT_DYNAMICS
from pfviz.vision.shapes import DEFAULT_SHAPE
from pfviz.vision.tracker import DEFAULT_MODEL
from pfviz_app.start_box import Assumptions

MEGABYTE = 10**6


def limits_of(options: argparse.Namespace) -> Limits:
    """What the options allow a file to cost."""
    return Limits(
        max_bytes=options.max_megabytes * MEGABYTE,
        max_pixels=options.max_pixels,
        max_frames=options.max_frames,
        patience=options.patience,
        max_memory=options.max_memory * MEGABYTE,
    )


def assumptions_of(options: argparse.Namespace) -> Assumptions:
    """What the options say of the object.

    Raises:
        ValueError: if there is nothing to learn its motion from where it is to be learnt.
    """
    return Assumptions(
        model=options.model or DEFAULT_MODEL,
        shape=options.shape or DEFAULT_SHAPE,
        dynamics=options.dynamics or DEFAULT_DYNAMICS,
        working_width=options.working_width,
        restart=not options.no_restart,
        learnt_from=options.learn_dynamics,
        learnt=_learnt(options.learn_dynamics) if options.learn_dynamics else None,
    )


def _learnt(path: str) -> Autoregression:
    """Of the positions in a CSV file.

    Raises:
        ValueError: if it cannot be read or has too few of them.
    """
    try:
        return learn_dynamics(read_states(path))
    except (OSError, ValueError, csv.Error) as error:
        trouble = getattr(error, "strerror", None) or str(error).removeprefix(f"{path}: ")
        raise ValueError(f"--learn-dynamics {display_name(path)}: {display_name(trouble)}") from None
