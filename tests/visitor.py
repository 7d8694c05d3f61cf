"""A visitor of the app in a browser: what they do, and what their page holds."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import BrowserContext, ConsoleMessage, Error, Locator

PATIENCE = 60_000
"""Milliseconds; software rendering on a busy machine draws less than one frame a second."""

_NODES = """stem => Object.fromEntries(
    Object.entries(window.__viserSceneTree?.getState() ?? {})
        .filter(([name, node]) => name.startsWith('/board/' + stem) && node.effectiveVisibility && node.message)
        .map(([name, {message: {type, props}}]) => [name.slice(7), {
            type,
            points: props.points === undefined ? null : Array.from(props.points),
            colors: props.colors === undefined ? null : Array.from(props.colors),
            size: props.render_width === undefined ? null : [props.render_width, props.render_height],
            place: window.__viserMutable.nodeRefFromName[name]?.position.toArray() ?? null,
        }]))"""
_HAS = """prefix => Object.entries(window.__viserSceneTree?.getState() ?? {})
    .some(([name, node]) => name.startsWith('/board/' + prefix) && node.effectiveVisibility)"""

_OF_VISER = "Unable to preventDefault inside passive event listener"
"""What viser's page says on every wheel or drag of a node; it does no harm."""

_CORNERS = ((-1, -1), (1, -1), (1, 1), (-1, 1))


class Visitor:
    """One window on the app."""

    def __init__(self, context: BrowserContext, url: str, number: int) -> None:
        self.number = number
        self.complaints: list[str] = []
        self._context, self._url = context, url
        self.page = context.new_page()
        self.page.on("console", self._heard)
        self.page.on("pageerror", lambda error: self.complaints.append(f"page error: {error} {error.stack}"))

    def _heard(self, message: ConsoleMessage) -> None:
        if message.type == "error" and _OF_VISER not in message.text:
            self.complaints.append(f"console: {message.text} ({message.location})")

    def arrive(self) -> None:
        self.page.goto(self._url)
        self.sees("toy.", "tracker.", any_of=True)
        self.until(self.looks_squarely, "the picture to fit the canvas")

    def leave(self) -> None:
        self._context.close()

    def photograph(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            self.page.screenshot(path=path, timeout=PATIENCE)
        except Error as error:
            path.with_suffix(".txt").write_text(str(error), encoding="utf-8")

    # What the page holds

    def nodes(self, stem: str = "") -> dict[str, dict[str, Any]]:
        """The visible nodes whose names begin with ``stem``; points in pixels of the canvas, y up."""
        return self.page.evaluate(_NODES, stem)

    def points(self, name: str) -> np.ndarray:
        """``(n, 3)``: the points of the visible nodes ``name`` and ``name.0``, ``name.1``, ..."""
        rows = [node["points"] for key, node in self.nodes(name).items() if _belongs(key, name)]
        return np.concatenate([np.reshape(row, (-1, 3)) for row in rows if row] or [np.empty((0, 3))])

    def lines(self, name: str) -> int:
        """How many lines the visible nodes ``name`` and ``name.0``, ... have."""
        return len(self.points(name)) // 2

    def look(self, name: str) -> dict[str, Any]:
        """The points and colours of the visible nodes ``name`` and ``name.0``, ...; equal looks, equal pictures."""
        return {key: (node["points"], node["colors"]) for key, node in self.nodes(name).items() if _belongs(key, name)}

    def canvas(self) -> tuple[float, float, float, float]:
        """Left, top, width and height of the canvas in the window."""
        box = self.page.locator("canvas").first.bounding_box()
        assert box
        return box["x"], box["y"], box["width"], box["height"]

    def camera(self) -> np.ndarray:
        """``(4, 3)``: where the camera's right, up and back point, and where it is."""
        return np.reshape(self.page.evaluate("() => window.__viserMutable.camera.matrixWorld.elements"), (4, 4))[:, :3]

    def looks_squarely(self) -> bool:
        """Whether the camera looks at right angles at the middle of a picture as large as the canvas."""
        right, up, _, position = self.camera()
        _, _, width, height = self.canvas()
        return np.allclose([right, up], [[0, 0, -1], [0, 1, 0]], atol=1e-3) and np.allclose(
            position[1:], [-height / 2, -width / 2], atol=1.0
        )

    def drawn(self) -> dict[str, np.ndarray]:
        """``(n, 2)`` by node: where the points, or the corners of the image, are seen, in pixels of the canvas."""
        _, _, width, height = self.canvas()
        distance, middle = float(self.camera()[3, 0]), np.array([width / 2, height / 2])
        seen = {}
        for name, node in self.nodes().items():
            if node["points"]:
                points = np.reshape(node["points"], (-1, 3))
            elif node["size"] and node["place"]:
                half = np.array(node["size"]) / 2
                points = [[*(np.array(node["place"][:2]) + half * corner), node["place"][2]] for corner in _CORNERS]
                points = np.array(points)
            else:
                continue
            flat = points[:, :2] * [1, -1] - middle
            seen[name] = middle + flat * distance / (distance - points[:, 2:])
        return seen

    def covered(self, places: np.ndarray) -> list[tuple[float, float]]:
        """Those of ``places (n, 2)``, in pixels of the canvas, that lie beside it or under something else."""
        left, top, _, _ = self.canvas()
        inside = self.page.evaluate(
            "places => places.map(([x, y]) => document.elementFromPoint(x, y)?.tagName === 'CANVAS')",
            (places + np.array([left, top])).tolist(),
        )
        return [tuple(place) for place, free in zip(places.round(1).tolist(), inside, strict=True) if not free]

    @property
    def time(self) -> int:
        return int(float(self._thumb("Time").get_attribute("aria-valuenow") or "nan"))

    def value(self, label: str) -> float:
        """What the slider ``label`` shows."""
        return float(self._thumb(label).get_attribute("aria-valuenow") or "nan")

    def typed(self, label: str) -> str:
        """What the number beside the slider ``label`` shows."""
        return self.number_of(label).input_value()

    # What the visitor waits for

    def sees(self, *prefixes: str, any_of: bool = False) -> None:
        """Wait until a visible node's name begins with each of ``prefixes``, or with any of them."""
        if any_of:
            script = f"prefixes => prefixes.some({_HAS})"
            self.page.wait_for_function(script, arg=list(prefixes), polling=100, timeout=PATIENCE)
            return
        for prefix in prefixes:
            self.page.wait_for_function(_HAS, arg=prefix, polling=100, timeout=PATIENCE)

    def sees_no(self, *prefixes: str) -> None:
        """Wait until no visible node's name begins with any of ``prefixes``."""
        for prefix in prefixes:
            script = f"prefix => !({_HAS})(prefix)"
            self.page.wait_for_function(script, arg=prefix, polling=100, timeout=PATIENCE)

    def until(self, condition: Any, what: str = "") -> Any:
        """Poll until ``condition()`` is true; its value."""
        deadline = time.monotonic() + PATIENCE / 1000
        while time.monotonic() < deadline:
            value = condition()
            if value:
                return value
            self.page.wait_for_timeout(100)
        raise AssertionError(f"waited in vain for {what or condition}")

    def at(self, t: int) -> None:
        """Wait until time ``t`` is shown, in the widget and in the picture."""
        self.until(lambda: self.time == t, f"time {t}, at {self.time}")

    def says(self, text: str) -> None:
        self.page.get_by_text(text).first.wait_for(state="visible")

    # What the visitor does

    def click(self, label: str) -> None:
        self.page.get_by_role("button", name=label, exact=True).click()
        self._lets_it_be_sent()

    def press(self, *keys: str) -> None:
        for key in keys:
            self.page.keyboard.press(key)

    def open(self, folder: str) -> None:
        self.page.get_by_text(folder, exact=True).click()

    def dismiss_notices(self) -> None:
        """Close what lies over the picture, such as the notice that rendering is done in software."""
        for button in self.page.locator(".mantine-Notification-closeButton").all():
            button.click()
        self.until(lambda: self.page.locator(".mantine-Notification-root").count() == 0)

    def choose(self, label: str, option: str) -> None:
        field = self.page.get_by_role("combobox", name=label, exact=True)
        field.click()
        self.page.get_by_role("option", name=option, exact=True).click()
        self.until(lambda: field.input_value() == option, f"{label} to be {option}")
        self._lets_it_be_sent()

    def options(self, label: str) -> Sequence[str]:
        self.page.get_by_role("combobox", name=label, exact=True).click()
        options = self.page.get_by_role("option").all_inner_texts()
        self.press("Escape")
        return options

    def type(self, label: str, value: object) -> None:
        """Type into the number beside a slider."""
        self.number_of(label).fill(str(value))
        self._lets_it_be_sent()

    def drag(self, label: str, *shares: float) -> None:
        """Drag the slider's thumb by the mouse to these shares of its length."""
        self._slider(label).scroll_into_view_if_needed()
        box = self._slider(label).bounding_box()
        thumb = self._thumb(label).bounding_box()
        assert box and thumb
        mouse = self.page.mouse
        mouse.move(thumb["x"] + thumb["width"] / 2, thumb["y"] + thumb["height"] / 2)
        mouse.down()
        for share in shares:
            mouse.move(box["x"] + share * box["width"], box["y"] + box["height"] / 2, steps=3)
        mouse.up()
        self._lets_it_be_sent()

    def _lets_it_be_sent(self) -> None:
        """viser sends the last change of all widgets in 50 ms, so nobody may be quicker from one to the next.

        A slider tells its change in the next frame, which may be late.
        """
        self.page.evaluate("() => new Promise(done => requestAnimationFrame(() => setTimeout(done, 60)))")

    def number_of(self, label: str) -> Locator:
        return self._slider(label).locator("xpath=following-sibling::*//input")

    def _slider(self, label: str) -> Locator:
        name = self.page.locator("label").filter(has_text=label).get_by_text(label, exact=True)
        return self.page.locator(f'[id="{name.get_attribute("for")}"]')

    def _thumb(self, label: str) -> Locator:
        return self._slider(label).get_by_role("slider")


def _belongs(key: str, name: str) -> bool:
    stem, _, last = key.rpartition(".")
    return key == name or (stem == name and last.isdecimal())
