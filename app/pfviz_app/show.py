"""``pfviz.show``: a world or a filter of one's own in the app, from Python."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from typing import Any

from pfviz.filters import FILTERS, Filter
from pfviz.worlds import WORLDS, World
from pfviz_app.served import prepare_video
from pfviz_app.server import run_app
from pfviz_app.settings import Settings


def show(
    world: World | str = "figure-1",
    filter: Filter | str = "rb-ss-hs-sir",
    *,
    video: str = "scene:twin",
    box: tuple[float, float, float, float] | None = None,
    seed: int = 0,
    host: str = "127.0.0.1",
    port: int | None = None,
    open_browser: bool = True,
) -> None:
    """Open the app on a world and a filter, by name or of one's own, until it is interrupted.

    Args:
        world: a name of ``pfviz worlds``, or a ``World`` of one or two dimensions.
        filter: a name of ``pfviz filters``, or anything with ``initial`` and ``step``. If it is a dataclass with a
            field ``n_particles``, the slider sets it.
        video: what the tracker's room shows: a file, ``camera:N`` or ``scene:NAME``.
        box: the object in its first frame, ``(x, y, width, height)`` in pixels.
        seed: of the film.
        host: address to listen on.
        port: to listen on; by default 8080 or the next free one.
        open_browser: whether to open a browser.

    Raises:
        ValueError: if there is no such world or filter, the world has more than two dimensions, or video, box or port
            cannot be used.
    """
    name, particles = _known_world(world)
    settings = replace(Settings(), toy_particles=particles, seed=seed)
    settings = settings.with_value("world", name).with_value("filter", _known_filter(filter))
    run_app(settings, prepare_video(video, box, 0), host, port, open_browser)


def _known_world(world: World | str) -> tuple[str, int]:
    """The world's name, under which it is now in the list, and its number of particles."""
    if isinstance(world, World):
        dimension = world.model.dynamics.dimension
        if dimension > 2:
            raise ValueError(f"world '{world.name}' has {dimension} dimensions; only one or two can be drawn")
        WORLDS[world.name] = world
        return world.name, world.n_particles
    return world, WORLDS[world].n_particles if world in WORLDS else 100


def _known_filter(filter_: Filter | str) -> str:
    """The filter's name, under which it is now in the list."""
    if isinstance(filter_, str):
        return filter_
    name = type(filter_).__name__
    FILTERS[name] = replace(
        FILTERS["condensation"], name=name, title=name, make=_maker(filter_), summary=f"{name}, of your own"
    )
    return name


def _maker(filter_: Filter) -> Any:
    adjustable = is_dataclass(filter_) and "n_particles" in {f.name for f in fields(filter_)}

    def make(n_particles: int, **settings: Any) -> Filter:
        return replace(filter_, n_particles=n_particles, **settings) if adjustable else filter_  # type: ignore[type-var]

    return make
