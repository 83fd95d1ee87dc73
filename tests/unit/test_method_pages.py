"""Every method of the tree has a page, the README's table links to it, and its links lead somewhere."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from renderers import registered_methods

ROOT = Path(__file__).parents[2]
NAMES = [name for name, method in registered_methods().items() if type(method).__module__.startswith("renderers.methods.")]


@pytest.mark.parametrize("name", NAMES)
def test_a_method_has_a_page_that_the_readme_links(name: str) -> None:
    page = ROOT / "docs" / "methods" / f"{name}.md"
    assert page.is_file(), f"write docs/methods/{name}.md: what it does, its settings, its claims, what it gets wrong"
    text = page.read_text()
    assert text.startswith("# ")
    assert len(text.split()) >= 80
    assert f"[`{name}`](docs/methods/{name}.md)" in (ROOT / "README.md").read_text()
    for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", text):
        assert (page.parent / target).exists(), f"docs/methods/{name}.md links to {target}, which isn't there"
