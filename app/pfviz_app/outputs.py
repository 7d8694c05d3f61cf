"""Files that a command writes: none is overwritten unasked, and each appears complete or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from secrets import token_hex

from pfviz.vision.limits import display_name


def check_outputs(outputs: Mapping[str, str | None], force: bool, source: str) -> None:
    """Refuse what must not be written to, before anything is computed.

    Args:
        outputs: the file that each option names, if it names one.
        force: whether files that exist may be replaced.
        source: what is read, which is never replaced.

    Raises:
        ValueError: naming the option and the file.
    """
    seen: dict[Path, str] = {}
    for option, name in outputs.items():
        if not name:
            continue
        path = Path(name)
        shown = f"{option} {display_name(name)}"
        if path.is_dir():
            raise ValueError(f"{shown}: is a folder, expected the name of a file to write")
        if not path.parent.is_dir():
            raise ValueError(f"{shown}: there is no folder '{display_name(path.parent)}' to write to")
        if not os.access(path.parent, os.W_OK):
            raise ValueError(f"{shown}: the folder '{display_name(path.parent)}' cannot be written to")
        real = path.resolve()
        if real in seen:
            raise ValueError(f"{shown}: is also the file of {seen[real]}")
        if path.exists() and os.path.exists(source) and path.samefile(source):
            raise ValueError(f"{shown}: is the video that is read")
        if path.is_file() and not force:
            raise ValueError(f"{shown}: exists already; --force replaces it")
        if path.exists() and not path.is_file():
            raise ValueError(f"{shown}: is not a regular file, so it cannot be replaced")
        seen[real] = option


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Where to write what is to appear at ``path`` when the block is over, or not at all if that raises."""
    partial = path.with_name(f".pfviz-{os.getpid()}-{token_hex(4)}.partial")
    try:
        yield partial
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)
