"""A running app, a real browser, and pages that must not complain."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, sync_playwright
from stand_ins import ROOT, environment
from visitor import PATIENCE, Visitor

RESULTS = ROOT / "test-results"
FLAGS = (
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
    "--no-first-run",
)


class App:
    """``pfviz serve`` as a user starts it."""

    def __init__(self, *options: object) -> None:
        self.port = free_port()
        words = ("serve", "--no-browser", "--port", self.port, *options)
        self._process = subprocess.Popen(
            [sys.executable, "-m", "pfviz_app", *map(str, words)],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            encoding="utf-8",
            env=environment(),
        )
        self.said: list[str] = []
        self._running = threading.Event()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        if not self._running.wait(60.0) or not self.said:
            self._process.kill()
            pytest.fail(f"the app did not start: {''.join(self.said)}")

    def _read(self) -> None:
        assert self._process.stdout
        for line in self._process.stdout:
            self.said.append(line)
            if "running at" in line:
                self._running.set()
        self._running.set()

    @property
    def url(self) -> str:
        found = re.search(r"http://\S+", "".join(self.said))
        assert found, self.said
        return found[0]

    def stop(self) -> None:
        """Ctrl-C. The app must end well, and must not have complained."""
        self._process.send_signal(signal.SIGINT)
        try:
            code = self._process.wait(30.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            pytest.fail("the app did not stop")
        self._reader.join(5.0)
        said = "".join(self.said)
        assert code == 0, said
        assert "Traceback" not in said and "ERROR" not in said and "rror:" not in said, said


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture(scope="module")
def serve() -> Iterator[Callable[..., App]]:
    """Starts apps; every one of them is stopped, and has to stop well, when the module's tests are done."""
    apps: list[App] = []

    def start(*options: object) -> App:
        apps.append(App(*options))
        return apps[-1]

    yield start
    faults = []
    for app in apps:
        try:
            app.stop()
        except (AssertionError, pytest.fail.Exception) as error:
            faults.append(str(error))
    assert not faults, "\n".join(faults)


@pytest.fixture(scope="module")
def app(serve: Callable[..., App]) -> App:
    """The app with its defaults."""
    return serve()


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=os.environ.get("PFVIZ_CHROMIUM") or None, args=list(FLAGS))
        yield browser
        browser.close()


_present: list[Visitor] = []
"""Everybody who has a page open."""


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> Generator[None, Any, Any]:
    report = yield
    if report.failed:
        name = re.sub(r"\W+", "-", f"{item.nodeid}-{call.when}").strip("-")
        for visitor in _present:
            visitor.photograph(RESULTS / f"{name}-{visitor.number}.png")
    return report


def enter(browser: Browser, app: App, width: int, height: int, query: str = "") -> Visitor:
    context = browser.new_context(viewport={"width": width, "height": height})
    context.set_default_timeout(PATIENCE)
    visitor = Visitor(context, app.url + query, len(_present))
    _present.append(visitor)
    return visitor


def leave(visitor: Visitor) -> None:
    _present.remove(visitor)
    visitor.leave()


@pytest.fixture
def visit(browser: Browser) -> Iterator[Callable[..., Visitor]]:
    """Opens apps in windows of their own and waits for the picture. In the end no page may have shown an error."""
    visitors: list[Visitor] = []

    def open_window(app: App, width: int = 1400, height: int = 850, query: str = "") -> Visitor:
        visitors.append(enter(browser, app, width, height, query))
        visitors[-1].arrive()
        return visitors[-1]

    yield open_window
    for visitor in visitors:
        leave(visitor)
    assert not [complaint for visitor in visitors for complaint in visitor.complaints]


@pytest.fixture(scope="module")
def regular(browser: Browser, app: App) -> Iterator[Visitor]:
    """A window on the app for all tests of a module."""
    visitor = enter(browser, app, 1200, 600)
    yield visitor
    leave(visitor)


@pytest.fixture
def visitor(regular: Visitor) -> Iterator[Visitor]:
    """Somebody whose session has just begun. In the end their page may not have shown an error."""
    regular.complaints.clear()
    regular.arrive()
    yield regular
    assert not regular.complaints


@pytest.fixture(scope="session")
def clips() -> Path:
    return Path(os.environ.get("PFVIZ_CLIPS", ROOT.parent / "shared" / "clips"))
