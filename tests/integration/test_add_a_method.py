"""docs/add-a-method.md, done: the page's own code is a method that renders and is listed."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import pytest

from renderers.images import read_exr
from service.cli import run

PAGE = Path(__file__).parents[2] / "docs" / "add-a-method.md"


@pytest.mark.gl
def test_the_pages_method_works(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    code = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)[0]
    (tmp_path / "ambient.py").write_text(code)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, [str(tmp_path), os.environ.get("PYTHONPATH")])))
    monkeypatch.setenv("LUXMETER_PLUGINS", "ambient")
    assert run(["methods", "ambient", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["settings"]["properties"]["sky"]["default"] == 1.0
    out = tmp_path / "out"
    assert run(["render", "cornell-box", "--method", "ambient", "--set", "sky=0.5", "--size", "24x18", "--out", str(out)]) == 0
    layers, _ = read_exr(out / "frame.exr")
    assert layers["beauty"].shape == (18, 24, 3)
    assert float(layers["beauty"].max()) <= 0.5
    assert float(layers["beauty"].mean()) > 0
    assert run(["render", "cornell-box", "--method", "ambient", "--set", "sky=-1", "--out", str(tmp_path / "no")]) == 2
