"""A folder of results that a run can be continued in."""

from __future__ import annotations

import hashlib
import json
import os
import platform
from collections.abc import Iterable, Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from pfviz.experiments.experiment import Experiment, ExperimentError, Job, Row, digest

_MANIFEST = "manifest.json"
_MEASURING = ("measure.py", "trackers.py")


class Results:
    """The rows of an experiment, one file for each finished job.

    A file appears under its name when it is complete, so that a run may be killed at any moment and continued. The
    manifest names the experiment and the fingerprint of its settings and of the code that measures: rows of another
    experiment, or of another version, are never mixed in.

    Attributes:
        folder: where all is.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def open(self, experiment: Experiment, jobs: Sequence[Job]) -> None:
        """Begin, or continue what is there.

        Raises:
            ExperimentError: if the folder cannot be used, or holds rows of something else.
        """
        identity = {"rows_of": experiment.origin, "fingerprint": fingerprint(experiment, jobs)}
        try:
            (self.folder / "rows").mkdir(parents=True, exist_ok=True)
            manifest = self._manifest()
            if manifest is None:
                self._check_empty()
                write_atomically(self.folder / _MANIFEST, json.dumps({**identity, "machine": machine()}, indent=2))
                return
        except OSError as error:
            raise ExperimentError(f"{self.folder}: cannot hold results: {error.strerror or error}") from None
        if manifest.get("rows_of") != experiment.origin:
            raise ExperimentError(
                f"{self.folder}: holds rows of '{manifest.get('rows_of')}', not of '{experiment.origin}': "
                "choose another --out"
            )
        if manifest.get("fingerprint") != identity["fingerprint"]:
            raise ExperimentError(
                f"{self.folder}: holds rows of '{experiment.origin}' with other settings or another version of pfviz: "
                "choose another --out, or delete it to begin anew"
            )

    def _manifest(self) -> dict[str, Any] | None:
        path = self.folder / _MANIFEST
        if not path.exists():
            return None
        try:
            manifest = json.loads(path.read_text(encoding="utf-8"))
        except ValueError:
            manifest = None
        if not isinstance(manifest, dict):
            raise ExperimentError(f"{path}: is not a manifest of results: choose another --out")
        return manifest

    def _check_empty(self) -> None:
        if any((self.folder / "rows").iterdir()):
            raise ExperimentError(f"{self.folder}: has rows but no {_MANIFEST}: choose another --out")

    def _shard(self, job: Job) -> Path:
        return self.folder / "rows" / f"{job.key}.jsonl"

    def write(self, job: Job, rows: Iterable[Row]) -> None:
        """Store the rows of a finished job."""
        write_atomically(self._shard(job), "".join(f"{json.dumps(row)}\n" for row in rows))

    def read(self, job: Job) -> list[Row] | None:
        """The rows of a job, or None where it has not run, or what is there is not whole."""
        try:
            lines = self._shard(job).read_text(encoding="utf-8").splitlines()
            rows = [json.loads(line) for line in lines]
        except (OSError, ValueError):
            return None
        return rows if {row.get("seed") for row in rows} == set(job.seeds) else None


def write_atomically(path: Path, text: str) -> None:
    """Write a text file that is there as a whole or not at all."""
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        with partial.open("w", encoding="utf-8", newline="\n") as stream:
            stream.write(text)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


def fingerprint(experiment: Experiment, jobs: Sequence[Job]) -> str:
    """A digest of what decides the rows, but for the seeds: settings, version, and the library's code."""
    settings = sorted({json.dumps(dict(job.settings), sort_keys=True) for job in jobs})
    return digest([experiment.origin, experiment.version, settings, code_digest()])


@cache
def code_digest() -> str:
    """A digest of the modules that rows come from: all of pfviz but reports and the like."""
    root = Path(__file__).resolve().parents[1]
    code = hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        relative = path.relative_to(root)
        if relative.parts[0] not in ("experiments", "figures.py") or relative.name in _MEASURING:
            code.update(relative.as_posix().encode() + b"\0" + path.read_bytes())
    return code.hexdigest()[:20]


def machine() -> dict[str, Any]:
    """What the results were measured on."""
    return {
        "system": platform.platform(),
        "processor": _processor(),
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        **{name: _version(name) for name in ("pfviz", "numpy", "numba", "opencv-python-headless")},
    }


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "unknown")
