"""The pages in headless Chromium over the real service, with its worker: submit, see the cells fill, read the report."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from browsers import watched
from service_processes import service

pytestmark = [pytest.mark.browser, pytest.mark.mitsuba, pytest.mark.usefixtures("toy_methods")]
# What the cells said whenever they changed, kept over the reload at the end.
REMEMBER = """() => {
    const say = () => [...document.querySelectorAll('.matrix .cell')].map(c => c.textContent).join()
    sessionStorage.seen = say()
    new MutationObserver(() => { sessionStorage.seen += ';' + say() })
        .observe(document.querySelector('#live'), {childList: true, subtree: true})
}"""


@pytest.fixture
def address(tmp_path: Path, toy_methods: None) -> Iterator[str]:
    with service({"LUXMETER_HOME": str(tmp_path / "home")}, tmp_path / "log") as found:
        yield found


def test_from_the_form_to_the_report(browser: object, address: str) -> None:
    with watched(browser, address, base_url=address) as page:
        page.goto("/submit")
        page.check("[name=method][value=flat]")
        page.fill("[id='flat.level']", "0.25, 0.5")
        for field, value in (("seeds", 2), ("width", 8), ("height", 6), ("noise", 0.5)):
            page.fill(f"#{field}", str(value))
        page.click("button.primary")
        page.wait_for_url("**/evaluations/*")
        page.evaluate(REMEMBER)
        page.wait_for_function("() => document.querySelectorAll('.matrix .cell').length === 2")
        here = page.url
        page.wait_for_selector(".actions >> text=Report", timeout=90_000)
        assert page.locator(".matrix .cell").all_inner_texts() == ["2 of 2", "2 of 2"]
        seen = page.evaluate("sessionStorage.seen").split(";")
        assert len(dict.fromkeys(seen)) >= 2, "the cells did not fill in while the page was open"
        page.click(".actions >> text=Report")
        page.wait_for_url("**/report/")
        assert "Speed against error" in page.inner_text("h1")
        assert page.locator(".viewer").count() >= 1
        page.goto(here)
        assert page.evaluate("document.querySelector('#evaluation').dataset.ended") == "yes"
        page.goto("/")
        assert page.locator("a[href^='/evaluations/']").count() >= 1
