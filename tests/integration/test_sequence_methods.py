"""Methods with state between frames: ranges in Python, and as a render task."""

import json
from pathlib import Path
from typing import Any

import pytest

from jobs.rendering import render
from jobs.tasks import FrameOutput, RenderTask
from renderers import get_method, load_scene
from renderers.images import read_exr

pytestmark = pytest.mark.usefixtures("toy_methods")


@pytest.fixture(autouse=True)
def no_device(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("renderers.method", "jobs.rendering"):
        monkeypatch.setattr(f"{module}.device_string", lambda: "no device")


def test_frames_of_a_range_follow_one_another() -> None:
    scene, method = load_scene("cornell-box"), get_method("tally")
    frames = list(method.render_frames(scene, size=(4, 3), frames=(5, 7)))
    assert [frame.layers["beauty"][0, 0, 0] for frame in frames] == [1, 2, 3]
    assert [frame.counters["frame"] for frame in frames] == [5, 6, 7]
    assert [len(frame.timings) for frame in frames] == [1, 1, 1]


def test_one_frame_is_a_range_of_one() -> None:
    assert (get_method("tally").render(load_scene("cornell-box"), size=(4, 3), frame=6).layers["beauty"] == 1).all()


@pytest.mark.parametrize("span", [(3, 2), (-1, 2)])
def test_ranges_that_are_none_are_refused_at_once(span: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match="0 ≤ A ≤ B"):
        get_method("tally").render_frames(load_scene("cornell-box"), frames=span)


def test_a_method_without_state_renders_each_frame_by_itself() -> None:
    scene, method = load_scene("cornell-box"), get_method("flat")
    frames = list(method.render_frames(scene, size=(4, 3), frames=(1, 3)))
    for number, frame in enumerate(frames, start=1):
        assert (frame.layers["beauty"] == method.render(scene, size=(4, 3), frame=number).layers["beauty"]).all()


@pytest.mark.parametrize("repeats", [1, 2])
def test_a_render_task_keeps_the_state_of_each_repetition_apart(repeats: int, tmp_path: Path) -> None:
    outputs = tuple(FrameOutput(frame=k, image=f"{k}.exr", result=f"{k}.json") for k in (2, 3, 4))
    told = list[dict[str, Any]]()
    task = RenderTask(
        scene="cornell-box", scene_name="cornell-box", method="tally", label="tally", settings={}, seed=0, size=(4, 3),
        repeats=repeats, outputs=outputs, folder=tmp_path,
    )  # fmt: skip
    assert render(task, told.append)["frames"] == 3
    assert [read_exr(tmp_path / output.image)[0]["beauty"][0, 0, 0] for output in outputs] == [1, 2, 3]
    assert [json.loads((tmp_path / output.result).read_text())["counters"]["frame"] for output in outputs] == [2, 3, 4]
    assert [each["done"] for each in told] == [1, 2, 3]
