"""Headless Chromium, and pages on which nothing may go wrong."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"]


@contextmanager
def chromium() -> Iterator[Any]:
    """A browser, as playwright knows it. Skips the test where there is none."""
    if CHROMIUM is None:
        pytest.skip("no Chromium on this machine")
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with playwright.sync_playwright() as p:
        found = p.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield found
        found.close()


@contextmanager
def watched(browser: Any, *own: str, **options: Any) -> Iterator[Any]:
    """A page without script errors, without anything that a security policy blocks, and with no address that begins otherwise than
    with one of `own`. options: of the page."""
    opened = browser.new_page(viewport={"width": 1280, "height": 900}, **options)
    wrong: list[str] = []
    # The only console message let through is Chromium's advice about the tests' own getImageData calls.
    said = lambda m: m.type in ("error", "warning") and "willReadFrequently" not in m.text  # noqa: E731
    opened.on("console", lambda m: wrong.append(m.text) if said(m) else None)
    opened.on("pageerror", lambda e: wrong.append(str(e)))
    opened.on("request", lambda r: None if r.url.startswith((*own, "data:")) else wrong.append(r.url))
    yield opened
    opened.close()
    assert wrong == []
