"""Share codes: everything that is needed to see again exactly what somebody sees."""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from pfviz.vision.limits import display_name
from pfviz_app.differences import differences
from pfviz_app.films import Start
from pfviz_app.settings import RUNNING, SettingError, Settings

_CODE = "pf2-"
PLACE_DIGITS, CORNER_DIGITS = 4, 1
"""How exactly a code says where the target was put, and where the corners of an outline are."""
_LONGEST, _LATEST, _FARTHEST, _MOST_CORNERS = 65_536, 2000, 1e6, 1000
Changes = tuple[tuple[int, Settings], ...]


@dataclass(frozen=True, slots=True)
class Shared:
    """What a share code stands for.

    Attributes:
        settings: as they are now.
        t: the time on screen.
        stage: the stage on screen; None for the whole iteration.
        changes: where settings were changed on the way: from which step on, and what they were from there. The first
            holds from step 1; empty where they were always those of now.
        rival_changes: the same of the lane that is compared with, where it has gone its own way.
        held: where the target was put, by time.
        start: what is followed in the video, where a visitor has chosen it.
        video: which one it is, as everybody may know it; None in codes that were made before they said so.
    """

    settings: Settings
    t: int = 0
    stage: int | None = None
    changes: Changes = ()
    rival_changes: Changes = ()
    held: Mapping[int, tuple[float, ...]] = field(default_factory=dict)
    start: Start | None = None
    video: str | None = None

    def at(self, t: int) -> Settings:
        """The settings under which step ``t`` was run."""
        return _at(self.changes, t) or self.settings

    def rival_at(self, t: int) -> Settings | None:
        """The settings of the lane compared with, where they are known; else they follow from the others."""
        return _at(self.rival_changes, t)

    def brought_to(self, video: str) -> tuple[Shared, str]:
        """What can be seen of it where ``video`` is shown, and a sentence on what cannot; empty where all can.

        What was marked in one video means nothing in another. There is followed what that one begins with.
        """
        if self.video in (None, video):
            return self, ""
        note = f"This was shared with the video {self.video}, and here it is {video}: only the toy is the same."
        return replace(self, start=None), note


def changes(log: Iterable[Settings]) -> Changes:
    """Where the settings of the steps 1, 2, ... change."""
    found: list[tuple[int, Settings]] = []
    for t, settings in enumerate(log, start=1):
        if not found or differences(settings, found[-1][1], RUNNING):
            found.append((t, settings))
    return tuple(found)


def encode(shared: Shared) -> str:
    """A short code; see ``decode``."""
    values = differences(shared.settings, Settings())
    values |= {"t": shared.t} if shared.t else {}
    values |= {} if shared.stage is None else {"stage": shared.stage}
    for key, steps in (("changes", shared.changes), ("rivals", shared.rival_changes)):
        changed = [[t, differences(settings, shared.settings, RUNNING)] for t, settings in steps]
        if changed and (key == "rivals" or any(unlike for _, unlike in changed)):
            values[key] = changed
    if shared.held:
        values["held"] = [[t, *(round(x, PLACE_DIGITS) for x in place)] for t, place in sorted(shared.held.items())]
    if shared.start is not None:
        corners = [[round(x, CORNER_DIGITS) for x in corner] for corner in shared.start.outline]
        values["start"] = [shared.start.frame, *corners]
    values |= {} if shared.video is None else {"video": shared.video}
    text = json.dumps(values, separators=(",", ":"))
    return _CODE + base64.urlsafe_b64encode(zlib.compress(text.encode(), 9)).decode().rstrip("=")


def decode(code: str) -> Shared:
    """What a share code stands for.

    Raises:
        SettingError: if it is not a share code, or asks for something there is not.
    """
    values = _unpacked(code)
    t = _whole("time", values.pop("t", 0), _LATEST)
    stage = values.pop("stage", None)
    stage = None if stage is None else _whole("stage", stage, 20)
    steps = {key: values.pop(key, []) for key in ("changes", "rivals")}
    held = _held(values.pop("held", []))
    start = _start(values.pop("start", None))
    video = _video(values.pop("video", None))
    settings = _changed(Settings(), values)
    own, rival = (_steps(steps[key], settings) for key in ("changes", "rivals"))
    return Shared(settings, t, stage, own, rival, held, start, video)


def _unpacked(code: str) -> dict[str, Any]:
    body = code.strip().removeprefix(_CODE)
    try:
        packed = base64.urlsafe_b64decode(body + "=" * (-len(body) % 4))
        unpacking = zlib.decompressobj()
        values = json.loads(unpacking.decompress(packed, _LONGEST))
        if not unpacking.eof or not isinstance(values, dict):
            raise ValueError("cut short")
    except (ValueError, TypeError, RecursionError, zlib.error):
        raise SettingError(f"{code[:40]!r} is not a share code: expected one that begins with {_CODE}") from None
    return values


def _whole(what: str, value: Any, most: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= most:
        raise SettingError(f"the share code asks for {what} {value!r}: expected 0 to {most}")
    return value


def _changed(settings: Settings, values: Any) -> Settings:
    if not isinstance(values, dict):
        raise SettingError(f"the share code has settings {values!r}: expected names and values")
    for name, value in values.items():
        settings = settings.with_value(name, value)
    return settings


def _steps(values: Any, settings: Settings) -> Changes:
    try:
        pairs = [(t, changed) for t, changed in values]
    except (TypeError, ValueError):
        raise SettingError("the share code's changes are broken: expected times and settings") from None
    return tuple((_whole("time", t, _LATEST), _changed(settings, changed)) for t, changed in pairs)


def _held(values: Any) -> dict[int, tuple[float, ...]]:
    held = {}
    for row in values if isinstance(values, list) else [values]:
        if not isinstance(row, list) or not 2 <= len(row) <= 3:
            raise SettingError(f"the share code puts the target at {row!r}: expected a time and one or two numbers")
        held[_whole("time", row[0], _LATEST)] = _numbers(row[1:])
    return held


def _start(value: Any) -> Start | None:
    if value is None:
        return None
    sound = isinstance(value, list) and 3 <= len(value) <= _MOST_CORNERS
    if not sound or not all(isinstance(row, list) and len(row) == 2 for row in value[1:]):
        raise SettingError("the share code's outline is broken: expected a frame and the corners")
    corners = [_numbers(row) for row in value[1:]]
    return Start(_whole("frame", value[0], 10**7), tuple((x, y) for x, y in corners))


def _video(value: Any) -> str | None:
    if value is not None and (not isinstance(value, str) or display_name(value) != value):
        raise SettingError(f"the share code names a video {str(value)[:40]!r}: expected the name of a file or a scene")
    return value


def _numbers(row: list[Any]) -> tuple[float, ...]:
    if not all(isinstance(x, int | float) and abs(x) <= _FARTHEST for x in row):
        raise SettingError(f"the share code has a place {row!r}: expected numbers up to {_FARTHEST:g}")
    return tuple(float(x) for x in row)


def _at(steps: Changes, t: int) -> Settings | None:
    return next((settings for start, settings in reversed(steps) if start <= t), None)
