"""`pt`: equal to the reference in expectation, equal to itself in every byte."""

from __future__ import annotations

import hashlib
import subprocess
import sys

import numpy as np
import pytest
from pydantic import ValidationError

import renderers
from renderers.images import luminance
from renderers.reference import render
from renderers.scene.builder import SceneBuilder
from renderers.scene.model import Lambert, Scene

pytestmark = pytest.mark.mitsuba

SIZE = (24, 18)


@pytest.fixture(autouse=True)
def _no_gl(monkeypatch: pytest.MonkeyPatch) -> None:
    """`pt` ignores the OpenGL device; asking for it needs a context."""
    monkeypatch.setattr("renderers.method.device_string", lambda: "none")


@pytest.fixture(scope="module")
def cornell() -> Scene:
    return renderers.load_scene("cornell-box")


@pytest.fixture(scope="module")
def pt() -> renderers.Method:
    return renderers.get_method("pt")


@pytest.mark.parametrize("transport", renderers.TRANSPORTS)
@pytest.mark.parametrize("pixel", ["centre", "box"])
def test_the_mean_over_seeds_is_the_reference(
    cornell: Scene, pt: renderers.Method, transport: renderers.Transport, pixel: str
) -> None:
    truth = render(cornell, transport, SIZE, noise=0.01, pixel=pixel)  # type: ignore[arg-type]
    settings = pt.Settings(transport=transport, spp=64, pixel=pixel)
    frames = np.array([luminance(pt.render(cornell, settings, size=SIZE, seed=k).layers["beauty"]) for k in range(16)])
    spread = np.sqrt(frames.var(axis=0, ddof=1) / 16 + truth.luminance_variance)
    noisy = spread > 1e-6
    np.testing.assert_allclose(frames.mean(axis=0)[~noisy], luminance(truth.image)[~noisy], rtol=1e-5, atol=1e-5)
    if noisy.any():
        score = (frames.mean(axis=0) - luminance(truth.image))[noisy] / spread[noisy]
        # Mean square of Student-like scores: 1.15 for 15 degrees of freedom; a bias of one standard error would give 2.
        assert np.mean(score**2) < 1.6


def test_error_falls_with_the_root_of_spp(cornell: Scene, pt: renderers.Method) -> None:
    def variance(spp: int) -> float:
        frames = [pt.render(cornell, pt.Settings(spp=spp), size=SIZE, seed=k).layers["beauty"] for k in range(8)]
        return float(np.var(frames, axis=0, ddof=1).mean())

    # Stratification makes it fall faster than 1/spp, never slower; a factor 2 covers the noise of 8 seeds.
    assert variance(144) < variance(9) / 8


def test_same_call_same_bytes_and_another_seed_another_picture(cornell: Scene, pt: renderers.Method) -> None:
    settings = pt.Settings(spp=7)
    a, b, c = (pt.render(cornell, settings, size=SIZE, seed=s).layers["beauty"] for s in (3, 3, 4))
    assert a.tobytes() == b.tobytes()
    assert a.tobytes() != c.tobytes()


def test_same_bytes_in_another_process_and_with_one_thread(cornell: Scene, pt: renderers.Method) -> None:
    here = pt.render(cornell, pt.Settings(spp=7, subpixels=2), size=SIZE, seed=3).layers["beauty"]
    code = (
        "import drjit as dr; dr.set_thread_count(1);"
        "import hashlib, renderers, renderers.method as m; m.device_string = lambda: 'none';"
        "pt = renderers.get_method('pt');"
        "f = pt.render(renderers.load_scene('cornell-box'), pt.Settings(spp=7, subpixels=2), size=(24, 18), seed=3);"
        "print(hashlib.sha256(f.layers['beauty'].tobytes()).hexdigest())"
    )
    there = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()
    assert there == hashlib.sha256(here.tobytes()).hexdigest()


def test_counters_timings_and_layers(cornell: Scene, pt: renderers.Method) -> None:
    frame = pt.render(cornell, pt.Settings(transport="direct", spp=10, subpixels=2), size=SIZE)
    assert frame.counters == {"paths": 24 * 18 * 10 * 4, "spp": 10}
    assert [(t.name, t.stage) for t in frame.timings] == [("export", "prepare"), ("warm-up", "prepare"), ("paths", "render")]
    np.testing.assert_array_equal(frame.layers["direct"] + frame.layers["indirect"], frame.layers["beauty"])
    assert set(pt.render(cornell, pt.Settings(spp=1), size=SIZE).layers) == {"beauty"}


def test_subpixels_sample_the_pixel_on_a_grid(cornell: Scene, pt: renderers.Method) -> None:
    """4x4 sub-pixels come closer to the box-filtered truth of a scene without other noise than the centre does."""
    box = render(cornell, "direct", SIZE, noise=1.0, pixel="box").image
    error = [
        np.abs(pt.render(cornell, pt.Settings(transport="direct", spp=1, subpixels=k), size=SIZE).layers["beauty"] - box).mean()
        for k in (1, 4)
    ]
    assert error[1] < error[0] / 3


def test_seconds_become_spp_in_the_plan_only(cornell: Scene, pt: renderers.Method) -> None:
    settings = pt.Settings(seconds=0.2)
    with pytest.raises(ValueError, match="seconds"):
        pt.render(cornell, settings, size=SIZE)
    planned = pt.plan(cornell, settings, SIZE)  # type: ignore[attr-defined]
    assert planned.seconds is None
    assert planned.spp > 1
    assert pt.plan(cornell, pt.Settings(spp=5), SIZE) == pt.Settings(spp=5)  # type: ignore[attr-defined]


def test_the_transport_is_the_one_asked_for(pt: renderers.Method) -> None:
    assert [pt.transport(pt.Settings(transport=t)) for t in renderers.TRANSPORTS] == list(renderers.TRANSPORTS)


@pytest.mark.parametrize("bad", [{"spp": 0}, {"seconds": -1}, {"transport": "fast"}, {"rays": 4}])
def test_settings_out_of_range_are_refused(pt: renderers.Method, bad: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        pt.Settings(**bad)


def test_dark_scenes_are_black(pt: renderers.Method) -> None:
    b = SceneBuilder("dark")
    b.quad([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], b.material(Lambert()))
    b.camera((0, 1, 2), (0, 0, 0), 1.0)
    assert not pt.render(b.build(), pt.Settings(spp=2), size=SIZE).layers["beauty"].any()
