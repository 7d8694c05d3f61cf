"""A drawing board on top of viser's scene: draw in pixels, by name, again and again.

A node is created when its name is first drawn and only updated afterwards; what was not drawn since ``begin`` is
hidden by ``finish``. The board lies in a plane that the camera looks at squarely through a small field of view, so one
unit of the scene is one pixel of the canvas. It can still be orbited.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import viser
from numpy.typing import ArrayLike, NDArray
from viser._messages import SceneNodeUpdateMessage

from pfviz.particles import IntArray
from pfviz_app.picture import Pick
from pfviz_app.stage.layout import Rect
from pfviz_app.stage.lettering import lettered
from pfviz_app.stage.palette import Colours, Rgb, blend

_ROOT = "/board"
_FIELD_OF_VIEW = 0.12
_UPRIGHT = (np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0)
_THICKNESSES = (1.0, 1.8, 3.0)
_SIZES = (0.5, 0.85, 1.3)
_TEXT_DEPTH = 30.0
_REACH = 16.0
Anchor = Literal["left", "centre", "right"]
Room = Literal["toy", "tracker"]


class Board:
    """Named marks in pixel coordinates on one visitor's scene. Used by one thread.

    Attributes:
        background: the colour of the canvas.
        scope: put before every name, so that the same drawing can be made twice.
    """

    def __init__(self, client: viser.ClientHandle, on_grab: Callable[[float, float, bool], None]) -> None:
        self._client, self._on_grab = client, on_grab
        self._scene = client.scene
        self._nodes: dict[str, Any] = {}
        self._props: dict[str, dict[str, Any]] = {}
        self._drawn: set[str] = set()
        self._looks: dict[str, tuple[Any, ...]] = {}
        self._targets: list[tuple[Room, NDArray[np.float64], IntArray, bool]] = []
        self.scope = ""
        self.background: Rgb = (255, 255, 255)
        self._scene.add_frame(_ROOT, wxyz=_UPRIGHT, show_axes=False)

    def fit_camera(self, width: float, height: float) -> None:
        """Look squarely at a canvas of this size, one unit a pixel."""
        distance = height / 2.0 / np.tan(_FIELD_OF_VIEW / 2.0)
        camera = self._client.camera
        camera.fov = _FIELD_OF_VIEW
        camera.near, camera.far = distance / 10.0, distance * 4.0
        camera.up_direction = (0.0, 0.0, 1.0)
        camera.position = (width / 2.0, -distance, -height / 2.0)
        camera.look_at = (width / 2.0, 0.0, -height / 2.0)

    def begin(self, background: Rgb) -> None:
        self._drawn.clear()
        self._targets.clear()
        self.background = background

    def finish(self) -> None:
        """Hide what was not drawn since ``begin``."""
        for name, node in self._nodes.items():
            if node.visible != (name in self._drawn):
                node.visible = name in self._drawn

    def target(self, room: Room, points: ArrayLike, indices: IntArray) -> None:
        """Let what is drawn at ``points (n, 2 or 3)`` be clicked: it stands for the particles at ``indices (n,)``."""
        self._targets.append((room, np.asarray(points, dtype=float)[:, :2], indices, bool(self.scope)))

    def pick(self, x: float, y: float) -> Pick | None:
        """The particle nearest to a pixel, within reach of a finger."""
        best, found = _REACH, None
        for room, points, indices, rival in self._targets:
            if len(points):
                distances = np.hypot(points[:, 0] - x, points[:, 1] - y)
                nearest = int(np.argmin(distances))
                if distances[nearest] < best:
                    best, found = float(distances[nearest]), Pick(room, int(indices[nearest]), rival)
        return found

    def segments(
        self, name: str, points: ArrayLike, colours: Colours | Rgb, thickness: float = 1.5, depth: float = 0.0
    ) -> None:
        """Straight lines: ``points (n, 2, 2 or 3)`` in pixels; ``colours`` one for all or ``(n, 3)``."""
        placed = _placed(points, depth)
        if not len(placed):
            return
        colour = np.broadcast_to(_for_lines(colours).reshape(-1, 1, 3), (len(placed), 2, 3))
        self._draw(
            name,
            self._scene.add_line_segments,
            points=placed,
            colors=np.ascontiguousarray(colour),
            thickness=thickness,
            thickness_units="screen",
        )

    def polyline(
        self,
        name: str,
        points: ArrayLike,
        colour: Rgb,
        thickness: float = 1.5,
        depth: float = 0.0,
        closed: bool = False,
    ) -> None:
        """One line through ``points (n, 2 or 3)``, or several of equal length: ``(m, n, 2 or 3)``."""
        self.segments(name, joined(points, closed), colour, thickness, depth)

    def weighted_segments(
        self,
        name: str,
        points: ArrayLike,
        strengths: ArrayLike,
        colour: Rgb,
        depth: float = 0.0,
        weakest: Rgb | None = None,
    ) -> None:
        """Lines whose ``strengths (n,)`` from 0 to 1 are shown by colour and thickness together.

        A strength of 0 has the colour ``weakest``, by default one close to the background.
        """
        weakest = self._pale(colour, 0.12) if weakest is None else weakest
        points, strength = np.asarray(points, dtype=float), np.asarray(strengths, dtype=float)
        bins = _bin(strength, len(_THICKNESSES))
        for i, thickness in enumerate(_THICKNESSES):
            chosen = bins == i
            if chosen.any():
                colours = blend(weakest, colour, strength[chosen])
                self.segments(f"{name}/{i}", points[chosen], colours, thickness, depth + i)

    def points(
        self, name: str, points: ArrayLike, colours: Colours | Rgb, size: float = 8.0, depth: float = 0.0
    ) -> None:
        """Discs of diameter ``size``: ``points (n, 2 or 3)``; ``colours`` one for all or ``(n, 3)``."""
        placed = _placed(points, depth)
        if not len(placed):
            return
        self._draw(
            name,
            self._scene.add_point_cloud,
            points=placed,
            colors=np.ascontiguousarray(np.broadcast_to(np.asarray(colours, dtype=np.uint8), placed.shape)),
            point_size=size / 2.0,
            point_shape="circle",
            point_shading="flat",
            precision="float32",
        )

    def weighted_points(
        self,
        name: str,
        points: ArrayLike,
        strengths: ArrayLike,
        colour: Rgb,
        size: float = 8.0,
        depth: float = 0.0,
        weakest: Rgb | None = None,
    ) -> None:
        """Discs whose ``strengths (n,)`` from 0 to 1 are shown by colour and size together.

        A strength of 0 has the colour ``weakest``, by default one close to the background.
        """
        weakest = self._pale(colour, 0.25) if weakest is None else weakest
        points, strength = np.asarray(points, dtype=float), np.asarray(strengths, dtype=float)
        bins = _bin(strength, len(_SIZES))
        for i, factor in enumerate(_SIZES):
            chosen = bins == i
            if chosen.any():
                colours = blend(weakest, colour, strength[chosen])
                self.points(f"{name}/{i}", points[chosen], colours, size * factor, depth + i)

    def text(
        self,
        name: str,
        text: str,
        x: float,
        y: float,
        colour: Rgb,
        anchor: Anchor = "left",
        size: float = 12.5,
        bold: bool = False,
    ) -> None:
        """One line of text, its middle at height ``y`` and its ``anchor`` at ``x``."""
        if self._as_before(name, (text, x, y, colour, anchor, size, bold)):
            return
        picture, width, height = lettered(text, size, colour, bold)
        left = x - {"left": 0.0, "centre": width / 2.0, "right": width}[anchor]
        self.image(name, picture, Rect(left, y - height / 2.0, width, height), _TEXT_DEPTH)

    def handle(self, name: str, x: float, y: float, colour: Rgb) -> None:
        """Something to take hold of: dragging it tells ``on_grab`` the pixel, and whether that was the end of it."""
        new = self.scope + name not in self._nodes
        picture, width, height = lettered("✥", 21, colour, True)
        self.image(name, picture, Rect(x - width / 2.0, y - height / 2.0, width, height), _TEXT_DEPTH)
        if new:
            self._nodes[self.scope + name].on_drag(self._grabbed)

    async def _grabbed(self, event: Any) -> None:
        """A coroutine, so that what was dragged arrives in order."""
        x, y = event.end_screen_pos
        camera = self._client.camera
        self._on_grab(x * camera.image_width, y * camera.image_height, event.phase == "end")

    def rule(self, name: str, left: float, right: float, y: float, colour: Rgb, depth: float = 0.0) -> None:
        """A horizontal hairline."""
        if not self._as_before(name, (left, right, y, colour, depth)):
            self.segments(name, [[[left, y], [right, y]]], colour, 1.0, depth)

    def _as_before(self, name: str, looks: tuple[Any, ...]) -> bool:
        """Whether the node is there and looked like this when it was last drawn; if so, it is drawn again by that."""
        name = self.scope + name
        same = self._looks.get(name) == looks and name in self._nodes
        self._looks[name] = looks
        if same:
            self._drawn.add(name)
        return same

    def image(self, name: str, image: NDArray[np.uint8], rect: Rect, depth: float = -12.0) -> None:
        """An RGB or RGBA image that fills ``rect``."""
        name = self.scope + name
        node = self._nodes.get(name)
        self._drawn.add(name)
        x, y = rect.centre
        position = (x, -y, depth)
        if node is None:
            self._nodes[name] = self._scene.add_image(
                _path(name),
                image,
                rect.width,
                rect.height,
                format="jpeg" if image.shape[2] == 3 else "png",
                jpeg_quality=85,
                cast_shadow=False,
                receive_shadow=False,
                wxyz=(0.0, 1.0, 0.0, 0.0),
                position=position,
            )
            self._props[name] = {"image": image}
            return
        if self._props[name]["image"] is not image:
            node.image = image
            self._props[name]["image"] = image
        if (node.render_width, node.render_height) != (rect.width, rect.height):
            node.render_width, node.render_height = rect.width, rect.height
        if not np.array_equal(node.position, position):
            node.position = position

    def _pale(self, colour: Rgb, strength: float) -> Rgb:
        r, g, b = blend(self.background, colour, strength).tolist()
        return r, g, b

    def _draw(self, name: str, create: Any, **props: Any) -> Any:
        """Create the node, or update those of its properties that have changed."""
        name = self.scope + name
        self._drawn.add(name)
        node, before = self._nodes.get(name), self._props.get(name)
        if node is None or before is None:
            node = self._nodes[name] = create(_path(name), **props)
        else:
            _update(node, {key: value for key, value in props.items() if not _equal(before[key], value)})
        self._props[name] = props
        return node


def _equal(before: Any, now: Any) -> bool:
    """Whether a property is as it was; comparing bytes is ten times as quick as ``np.array_equal``."""
    if isinstance(now, np.ndarray):
        return before.shape == now.shape and before.tobytes() == now.tobytes()
    return before == now


def _update(node: Any, changed: dict[str, Any]) -> None:
    """Send the changed properties of a node as one message.

    Assigning them to the handle would copy, compare and queue each one on its own: half the time of a picture.
    """
    if changed:
        node._impl.api._queue_scene_message(SceneNodeUpdateMessage(node.name, changed))


def joined(points: ArrayLike, closed: bool = False) -> NDArray[np.float64]:
    """The segments ``(n, 2, d)`` of one line ``(n, d)`` or of several ``(m, n, d)``."""
    lines = np.asarray(points, dtype=float)
    lines = lines[None] if lines.ndim == 2 else lines
    if closed:
        lines = np.concatenate([lines, lines[:, :1]], axis=1)
    return np.stack([lines[:, :-1], lines[:, 1:]], axis=2).reshape(-1, 2, lines.shape[-1])


def arrow_heads(points: ArrayLike, length: float = 7.0) -> NDArray[np.float64]:
    """Two short strokes at the end of each segment: ``(n, 2, 2)`` in, ``(2 n, 2, 2)`` out."""
    segments = np.asarray(points, dtype=float)
    along = segments[:, 0] - segments[:, 1]
    along = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    tips = segments[:, 1]
    ends = [tips + length * (0.92 * along + sign * 0.38 * across) for sign in (1.0, -1.0)]
    return np.concatenate([np.stack([tips, end], axis=1) for end in ends])


def _placed(points: ArrayLike, depth: float) -> NDArray[np.float32]:
    """Pixel coordinates, y down, as scene coordinates, y up, ``depth`` pixels nearer to the viewer."""
    array = np.asarray(points, dtype=float)
    placed = np.empty((*array.shape[:-1], 3), dtype=np.float32)
    placed[..., 0], placed[..., 1] = array[..., 0], -array[..., 1]
    placed[..., 2] = depth + (array[..., 2] if array.shape[-1] == 3 else 0.0)
    return placed


def _path(name: str) -> str:
    """A flat path: in viser's tree a node would inherit its parent's place and visibility."""
    return f"{_ROOT}/{name.replace('/', '.')}"


def _for_lines(colours: Colours | Rgb) -> Colours:
    """Colours as line nodes need them: viser takes those of lines, unlike those of points, to be linear light."""
    return _LINEAR[np.asarray(colours, dtype=np.uint8)]


def _linear_light() -> Colours:
    encoded = np.arange(256) / 255.0
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    return np.rint(255.0 * linear).astype(np.uint8)


_LINEAR = _linear_light()


def _bin(strengths: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    return np.clip((strengths * count).astype(np.int64), 0, count - 1)
