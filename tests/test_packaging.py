"""What is installed: the wheel, the sdist, the locked versions."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from pfviz_app.assets_dir import assets_path

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
LOCK = (ROOT / "requirements.lock").read_text(encoding="utf-8")
LOCKED = [line for line in LOCK.splitlines() if line and not line.startswith("#")]


def run(*command: str | Path, cwd: Path) -> str:
    """Output of ``command``; fails the test with what it printed if it fails."""
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def distributions(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the sdist, and the wheel built from it."""
    folder = tmp_path_factory.mktemp("dist")
    run(sys.executable, "-m", "build", "--no-isolation", "--outdir", folder, ROOT, cwd=folder)
    return folder


@pytest.fixture(scope="module")
def wheel(distributions: Path) -> Path:
    (path,) = distributions.glob("*.whl")
    return path


def files_below(folder: Path) -> set[str]:
    return {
        path.relative_to(folder).as_posix()
        for path in folder.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }


def test_wheel_holds_library_app_and_assets_and_nothing_else(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        held = {name for name in archive.namelist() if ".dist-info/" not in name}
    expected = files_below(ROOT / "src") | files_below(ROOT / "app")
    expected |= {f"pfviz_app/assets/{name}" for name in files_below(ROOT / "assets")}
    assert held == expected


def test_wheel_names_its_command_and_licence(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        read = {Path(name).name: archive.read(name).decode() for name in archive.namelist() if ".dist-info/" in name}
    assert "pfviz = pfviz_app.cli:main" in read["entry_points.txt"]
    assert read["LICENSE"].startswith("MIT License")


def test_sdist_holds_what_a_build_and_a_test_run_need(distributions: Path) -> None:
    (path,) = distributions.glob("*.tar.gz")
    with tarfile.open(path) as archive:
        held = {name.split("/", 1)[1] for name in archive.getnames()}
    needed = {"Makefile", "pyproject.toml", "requirements.lock", "scripts/environment.sh", "assets/icon.svg"}
    assert needed | {"README.md", "LICENSE", "tests/test_packaging.py"} <= held


def test_installed_wheel_runs_outside_the_checkout(wheel: Path, tmp_path: Path) -> None:
    home = tmp_path / "venv"
    run(sys.executable, "-m", "venv", "--without-pip", home, cwd=tmp_path)
    scripts, python = ("Scripts", "python.exe") if sys.platform == "win32" else ("bin", "python")
    new_python = home / scripts / python
    run(
        sys.executable,
        "-m",
        "pip",
        "--python",
        new_python,
        "install",
        "--no-deps",
        "--no-index",
        wheel,
        cwd=tmp_path,
    )
    where = "import sysconfig; print(sysconfig.get_path('purelib'))"
    site = Path(run(new_python, "-c", where, cwd=tmp_path).strip())
    # Dependencies come from this environment; its editable install does not: a .pth reads no further .pth.
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib"), encoding="utf-8")

    show = "import pfviz, pfviz_app.assets_dir as a; print(pfviz.__file__); print(a.assets_path() / 'icon.svg')"
    for found in run(new_python, "-c", show, cwd=tmp_path).splitlines():
        assert Path(found).is_relative_to(site)
        assert Path(found).is_file()
    command = shutil.which("pfviz", path=str(home / scripts))
    assert command is not None
    assert "serve" in run(command, "--help", cwd=tmp_path)


def test_assets_are_found_from_the_checkout() -> None:
    assert (assets_path() / "icon.svg").is_file()


def test_lock_holds_exact_versions_and_nothing_else() -> None:
    assert not [line for line in LOCKED if not re.fullmatch(r"[a-z0-9-]+==[0-9][a-z0-9.]*( ; .+)?", line)]


def test_lock_names_no_host_and_no_path() -> None:
    assert not re.search(r"://|@|--|file:|/[a-z]|\\", LOCK)


def test_lock_has_every_dependency_in_a_version_that_is_allowed() -> None:
    locked = {Requirement(line).name: Requirement(line) for line in LOCKED}
    wanted = [*PROJECT["dependencies"], *PROJECT["optional-dependencies"]["dev"]]
    for requirement in map(Requirement, wanted):
        (exact,) = locked[requirement.name].specifier
        assert exact.version in requirement.specifier, requirement
