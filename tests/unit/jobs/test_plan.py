"""Requests become plans, or one clear line."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

import jobs
from jobs.files import safe_name
from jobs.graph import graph, references_of
from jobs.plan import plan
from renderers import Scene, SceneError, UnknownMethod
from renderers.scene import builtin

pytestmark = pytest.mark.usefixtures("toy_methods")


def request(**changes: object) -> jobs.EvaluationRequest:
    body = {"scenes": ["cornell-box"], "methods": [{"name": "flat"}], "size": (8, 4)} | changes
    return jobs.EvaluationRequest.model_validate(body)


def test_product_of_scenes_settings_sweeps_seeds_and_frames() -> None:
    wanted = {"name": "flat", "settings": {"mode": "good"}, "sweep": {"level": [0.1, 0.2]}}
    made = plan(
        request(scenes=["cornell-box", "cornell-box:light=area"], methods=[wanted, {"name": "budget"}], seeds=3, frames=(2, 3))
    )
    assert len(made.cells) == 2 * (2 + 1) * 3 * 2
    assert len(made.renders) == 2 * (2 + 1) * 3
    assert len({cell.id for cell in made.cells}) == len(made.cells)
    assert {cell.label for cell in made.cells} == {"flat mode=good level=0.1", "flat mode=good level=0.2", "budget"}
    assert all(cell.id == safe_name(cell.id) for cell in made.cells)


def test_references_are_those_that_the_cells_need() -> None:
    made = plan(request(methods=[{"name": "flat"}, {"name": "budget"}]))
    assert set(made.references) == {
        "cornell-box.direct.centre.f0000", "cornell-box.full.centre.f0000", "cornell-box.full.box.f0000",
    }  # fmt: skip


def test_exposure_needs_the_full_reference_of_frame_0() -> None:
    made = plan(request(frames=(3, 3)))
    assert "cornell-box.full.centre.f0000" in made.references
    assert "cornell-box.full.centre.f0003" in made.references


@pytest.mark.parametrize(
    ("frames", "references", "chosen"),
    [
        ((5, 24), None, list(range(5, 25))),
        ((5, 30), None, list(range(5, 31))),
        ((5, 64), None, [*range(5, 25), 25, 35, *range(45, 65)]),
        ((2, 14), {"every": 5}, [2, 7, 12]),
        ((2, 14), {"windows": [[4, 6], [6, 7]]}, [2, 4, 5, 6, 7]),
        ((2, 14), {"every": 6, "windows": [[8, 9]]}, [2, 8, 9, 14]),
        ((3, 3), {}, [3]),
    ],
)
def test_frames_of_a_sequence_that_have_references(frames: tuple[int, int], references: object, chosen: list[int]) -> None:
    made = plan(request(frames=frames, references=references))
    centre = [task.frame for task in made.references.values() if (task.transport, task.pixel) == ("direct", "centre")]
    assert centre == chosen
    assert {task.begin for task in made.references.values()} == {frames[0]}
    render = next(iter(made.renders))
    assert sorted(references_of(made, render)) == chosen
    assert len(made.renders[render].outputs) == frames[1] - frames[0] + 1


def test_graph_lists_every_node_after_those_it_waits_for() -> None:
    nodes = graph(plan(request(methods=[{"name": "flat"}, {"name": "budget", "settings": {"seconds": 0.4}}], seeds=2)))
    seen = set[str]()
    for node in nodes:
        assert seen.issuperset(node.after)
        seen.add(node.id)
    assert [node.kind for node in nodes].count("render") == 4
    assert [node.kind for node in nodes].count("pilot") == 1
    assert nodes[-1].kind == "report"


def test_id_ignores_priority_and_spelling_of_numbers_but_not_content() -> None:
    def id(**changes: object) -> str:
        return plan(request(**changes)).id

    assert id() == id(priority=9)
    assert id(methods=[{"name": "flat", "settings": {"level": "0.5"}}]) == id(
        methods=[{"name": "flat", "settings": {"level": 0.5}}]
    )
    assert id() != id(seeds=2)


def test_refused_scene_is_a_failed_cell_beside_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    from dataclasses import replace

    from renderers.scene.model import Environment

    box = builtin.BUILTIN["cornell-box"]

    def lit_box() -> Scene:
        """The box under an environment."""
        return replace(box(), environment=Environment())

    monkeypatch.setitem(builtin.BUILTIN, "lit-box", lit_box)
    made = plan(request(scenes=["lit-box", "cornell-box"]))
    assert made.refused == {"lit-box.flat.s0.f0000": "flat can't render cornell-box: needs environment"}
    assert [cell.state for cell in made.cells] == ["failed", "queued"]
    assert len(made.renders) == 1
    with pytest.raises(jobs.RequestError, match="needs environment"):
        plan(request(scenes=["lit-box"]))


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"scenes": ["nosuch"]}, SceneError, "unknown scene 'nosuch'"),
        ({"scenes": ["cornell-box:lamp=1"]}, SceneError, "no parameter 'lamp'; it has light"),
        ({"scenes": ["cornell-box", "cornell-box"]}, jobs.RequestError, "two scenes are called cornell-box"),
        ({"methods": [{"name": "nosuch"}]}, UnknownMethod, "unknown method 'nosuch'; known: "),
        (
            {"methods": [{"name": "flat", "settings": {"level": 11}}]},
            jobs.RequestError,
            r"flat.level must be number ≥ 0, ≤ 10 \(got 11\)",
        ),
        ({"methods": [{"name": "flat", "settings": {"mode": "fast"}}]}, jobs.RequestError, "flat.mode must be good or raise or"),
        (
            {"methods": [{"name": "flat", "settings": {"hue": 1}}]},
            jobs.RequestError,
            "flat has no setting 'hue'; it has subpixels, level",
        ),
        ({"methods": [{"name": "flat"}, {"name": "flat"}]}, jobs.RequestError, "flat is asked for twice"),
        ({"seeds": 256, "frames": (0, 1000)}, jobs.RequestError, "256256 cells are more than one evaluation takes"),
        (
            {"methods": [{"name": "ir", "sweep": {name: list(range(1, 1001)) for name in ("vpls", "blur", "bounces", "x")}}]},
            jobs.RequestError,
            "1000000000000 cells are more",
        ),
    ],
)
def test_refusals_name_what_is_wrong(changes: dict[str, object], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        plan(request(**changes))


@given(st.text(max_size=40))
def test_safe_names_are_safe(text: str) -> None:
    name = safe_name(text)
    assert name
    assert set(name) <= set("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-")
    assert name not in (".", "..")
    assert safe_name(name) == name


@pytest.mark.parametrize("window", [(0, 3), (3, 99), (5, 4)])
def test_windows_outside_of_the_frames_are_refused(window: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match=f"window {window[0]}:{window[1]} of references does not lie in frames 2:9"):
        request(frames=(2, 9), references={"windows": [window]})
