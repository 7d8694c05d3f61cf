"""One visitor's scene: shows drawings.

A node is created when a drawing first has a mark of its name, and only updated afterwards; what a drawing does not have
is hidden.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
import viser
from viser._messages import SceneNodeUpdateMessage, SetPositionMessage

from pfviz_app.stage.drawing import Drawing, Mark

_ROOT = "/board"
_FIELD_OF_VIEW = 0.12
_UPRIGHT = (np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0)
_EMPTY = np.zeros((1, 1, 3), np.uint8)


class Screen:
    """The nodes of one visitor's scene. Used by one thread.

    Args:
        client: the visitor.
        on_grab: told the pixel to which a mark is dragged, and whether that was the end of it.
    """

    def __init__(self, client: viser.ClientHandle, on_grab: Callable[[float, float, bool], None]) -> None:
        self._client, self._on_grab = client, on_grab
        self._scene = client.scene
        self._nodes: dict[str, Any] = {}
        self._shown: dict[str, Mark] = {}
        self._hidden: set[str] = set()
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

    def show(self, drawing: Drawing) -> None:
        """Show the drawing. Whoever calls makes it one update."""
        for name, mark in drawing.marks.items():
            before = self._shown.get(name)
            if before is None:
                self._create(name, mark, name in drawing.grips)
            elif before is not mark:
                self._update(name, before, mark)
            self._shown[name] = mark
        hidden = self._nodes.keys() - drawing.marks.keys()
        for name in hidden ^ self._hidden:
            self._nodes[name].visible = name not in hidden
        self._hidden = hidden

    def _create(self, name: str, mark: Mark, grip: bool) -> None:
        properties, path = dict(mark.properties), _path(name)
        if mark.kind == "lines":
            node: Any = self._scene.add_line_segments(path, **properties, thickness_units="screen")
        elif mark.kind == "points":
            flat: Any = {"point_shape": "circle", "point_shading": "flat", "precision": "float32"}
            node = self._scene.add_point_cloud(path, **properties, **flat)
        else:
            still: Any = {"cast_shadow": False, "receive_shadow": False, "wxyz": (0.0, 1.0, 0.0, 0.0)}
            node = self._scene.add_image(path, _EMPTY, 1.0, 1.0, position=mark.place, **still)
            self._scene._queue_scene_message(_Update(path, mark))
        if grip:
            node.on_drag(self._grabbed)
        self._nodes[name] = node

    def _update(self, name: str, before: Mark, mark: Mark) -> None:
        """Send a mark in place of another one, in one message.

        Assigning its properties to the handle would copy, compare and queue each one on its own: half the time of a
        picture.
        """
        path = _path(name)
        self._scene._queue_scene_message(_Update(path, mark))
        if mark.place != before.place:
            self._scene._queue_scene_message(SetPositionMessage(path, mark.place))

    async def _grabbed(self, event: Any) -> None:
        """A coroutine, so that what was dragged arrives in order."""
        x, y = event.end_screen_pos
        camera = self._client.camera
        self._on_grab(x * camera.image_width, y * camera.image_height, event.phase == "end")


class _Update(SceneNodeUpdateMessage):
    """All properties of a node at once; the latest counts. Thousands of these are sent a second.

    It is put on the wire as viser's own message is, without a look at every type.
    """

    def __init__(self, path: str, mark: Mark) -> None:
        self.name, self.updates, self.owner, self._mark = path, mark.properties, "", mark

    def redundancy_key(self) -> str:
        return self.name

    def as_serializable_dict(self, binary_buffers: list[memoryview] | None = None) -> dict[str, Any]:
        if binary_buffers is None:
            return super().as_serializable_dict() | {"type": "SceneNodeUpdateMessage"}
        updates = self.updates.copy()
        for key, kind, content in self._mark.arrays:
            updates[key] = {"__binary_index": len(binary_buffers), "dtype": kind}
            binary_buffers.append(content)
        return {"name": self.name, "updates": updates, "owner": self.owner, "type": "SceneNodeUpdateMessage"}


@lru_cache(maxsize=1024)
def _path(name: str) -> str:
    """A flat path: in viser's tree a node would inherit its parent's place and visibility."""
    return f"{_ROOT}/{name.replace('/', '.')}"
