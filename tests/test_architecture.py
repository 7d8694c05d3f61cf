"""Imports run one way, and the library stays light and knows nothing of the app."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
LAYERS = (
    {"names", "particles", "randomness", "model", "record", "genealogy"},
    {"resampling", "dynamics", "observations", "proposals"},
    {"kernels"},
    {"filters", "exact"},
    {"running", "worlds", "vision"},
    {"experiments", "figures"},
    {"pfviz"},  # the package itself, which may offer names of all its parts
    {"pfviz_app"},
)
RANKS = {part: rank for rank, layer in enumerate(LAYERS) for part in layer}


def module_name(path: Path, base: Path) -> str:
    parts = path.relative_to(base).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


FILES = {module_name(path, base): path for base in (ROOT / "src", ROOT / "app") for path in base.rglob("*.py")}


def part_of(module: str) -> str:
    """The part of the project, as LAYERS has it, that ``module`` belongs to."""
    names = module.split(".")
    return names[1] if names[0] == "pfviz" and len(names) > 1 else names[0]


def imported_modules(module: str, source: str, is_package: bool = False) -> Iterator[str]:
    """Every module that ``source`` imports, wherever in the file, relative imports resolved."""
    package = module.split(".") if is_package else module.split(".")[:-1]
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else []
            origin = ".".join([*above, *([node.module] if node.module else [])])
            for alias in node.names:
                yield f"{origin}.{alias.name}" if origin == "pfviz" else origin


def violations(module: str, source: str, is_package: bool = False) -> list[str]:
    """The imports of ``module`` that point up the layers, and those of the screen's library below the app."""
    importer = part_of(module)
    wrong = []
    for imported in imported_modules(module, source, is_package):
        target = part_of(imported)
        if imported.split(".")[0] in ("pfviz", "pfviz_app"):
            upward = RANKS.get(target, RANKS["pfviz"]) > RANKS[importer]
        else:
            upward = target == "viser" and importer != "pfviz_app"
        if upward:
            wrong.append(f"{module} imports {imported}")
    return wrong


def test_every_module_has_a_place_in_the_layers() -> None:
    assert not [module for module in FILES if part_of(module) not in RANKS]


def test_imports_run_one_way() -> None:
    wrong = [
        violation
        for module, path in FILES.items()
        for violation in violations(module, path.read_text(encoding="utf-8"), path.name == "__init__.py")
    ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("pfviz.particles", "import pfviz.filters"),
        ("pfviz.particles", "from pfviz import filters"),
        ("pfviz.particles", "import pfviz"),
        ("pfviz.kernels.histories", "from pfviz.filters.steps import resample"),
        ("pfviz.dynamics.autoregressive", "from ..kernels import histories"),
        ("pfviz.filters.steps", "def late():\n    from pfviz.worlds import WORLDS"),
        ("pfviz.worlds", "from pfviz.figures import draw"),
        ("pfviz.vision.tracker", "import viser.transforms"),
        ("pfviz.figures", "from viser import ViserServer"),
        ("pfviz.experiments.tables", "from pfviz_app.settings import Settings"),
    ],
)
def test_an_import_that_points_upward_is_found(module: str, source: str) -> None:
    assert len(violations(module, source)) == 1


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("pfviz.filters.steps", "from pfviz import kernels\nfrom . import registry\nimport numpy"),
        ("pfviz.worlds", "from .exact import kalman_step"),
        ("pfviz_app.server", "import viser\nimport pfviz\nfrom pfviz import figures"),
    ],
)
def test_an_import_that_points_downward_is_let_pass(module: str, source: str) -> None:
    assert violations(module, source) == []


def modules_loaded_by(module: str) -> set[str]:
    """Top-level modules in a fresh interpreter after ``import module``."""
    program = f"import {module}, sys, json; print(json.dumps([name.split('.')[0] for name in sys.modules]))"
    path = [str(ROOT / "src"), str(ROOT / "app")]
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path[:0] = {path!r}; {program}"],
        capture_output=True,
        text=True,
        check=True,
    )
    return set(json.loads(done.stdout))


@pytest.mark.parametrize("module", ["pfviz", "pfviz.filters", "pfviz.worlds", "pfviz.vision"])
def test_importing_the_library_is_light(module: str) -> None:
    loaded = modules_loaded_by(module)
    assert "pfviz" in loaded
    assert not loaded & {"viser", "matplotlib", "numba"}


@pytest.mark.parametrize("module", ["session", "settings", "commands"])
def test_what_a_visitor_can_ask_for_needs_no_screen(module: str) -> None:
    loaded = modules_loaded_by(f"pfviz_app.{module}")
    assert "pfviz_app" in loaded
    assert "viser" not in loaded
