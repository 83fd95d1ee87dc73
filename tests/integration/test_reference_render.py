"""Replicates, noise, caps, notes and the store of references."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import renderers
from renderers.images import luminance, read_exr
from renderers.reference import Reference, exposure, render
from renderers.reference import store as folder
from renderers.scene.builder import SceneBuilder
from renderers.scene.model import Environment, Lambert, PointLight, Scene

pytestmark = pytest.mark.mitsuba

SIZE = (16, 12)


@pytest.fixture(scope="module")
def cornell() -> Scene:
    return renderers.load_scene("cornell-box")


def same(a: Reference, b: Reference) -> bool:
    return a.n == b.n and all(
        np.array_equal(getattr(a, f), getattr(b, f)) for f in ("total", "squares", "squares_y", "surface", "alternating")
    )


def test_replicates_are_added_until_the_noise_is_reached(cornell: Scene) -> None:
    calls: list[tuple[int, float, float]] = []
    reference = render(cornell, "full", SIZE, noise=0.03, progress=lambda *call: calls.append(call))
    assert reference.noise <= 0.03
    assert reference.n >= 48
    assert reference.notes == ()
    assert [c[0] for c in calls] == list(range(2, reference.n + 1))
    assert calls[-1][1] == reference.noise
    assert calls[0][2] > calls[-1][2] == 0.0
    assert reference.image.dtype == reference.variance.dtype == np.float32
    assert reference.image.shape == (12, 16, 3)


def test_noise_is_the_stated_statistic(cornell: Scene) -> None:
    """From the replicates themselves, with numpy's own variance."""
    from renderers.reference.export import mitsuba_scene
    from renderers.reference.sampling import CENTRE, mean_image, reference_stream
    from renderers.reference.transports import estimator

    reference = render(cornell, "one-bounce", SIZE, noise=1.0)
    scene = mitsuba_scene(cornell.world(), SIZE)
    path = estimator("one-bounce", scene)
    replicates = np.array([mean_image(scene, path, SIZE, 64, reference_stream(k), CENTRE) for k in range(48)])
    assert reference.n == 48
    np.testing.assert_allclose(reference.image, replicates.mean(axis=0), rtol=1e-6)
    np.testing.assert_allclose(reference.variance, replicates.var(axis=0, ddof=1) / 48, rtol=1e-5, atol=1e-12)
    y = luminance(replicates)
    surface = reference.surface
    expected = np.sqrt((y.var(axis=0, ddof=1) / 48)[surface].mean()) / y.mean(axis=0)[surface].mean()
    assert reference.noise == pytest.approx(expected, rel=1e-5)


def test_a_stored_reference_is_continued_as_if_never_stopped(cornell: Scene, tmp_path: Path) -> None:
    whole = render(cornell, "full", SIZE, noise=1e-9, max_replicates=50, store=tmp_path / "a")
    part = render(cornell, "full", SIZE, noise=1e-9, max_replicates=7, store=tmp_path / "b")
    again = render(cornell, "full", SIZE, noise=1e-9, max_replicates=50, store=tmp_path / "b")
    assert part.n == 7
    assert same(whole, again)
    files = sorted(p.name for p in (tmp_path / "a").iterdir())
    assert files == sorted(p.name for p in (tmp_path / "b").iterdir())
    assert [Path(f).suffix for f in files] == [".exr", ".npz"]
    for name in files:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_sums_of_before_the_alternating_one_are_continued_without_it(cornell: Scene, tmp_path: Path) -> None:
    whole = render(cornell, "direct", size=SIZE, store=tmp_path, noise=1e-6, max_replicates=3)
    path = next(tmp_path.glob("*.npz"))
    with np.load(path) as file:
        np.savez(path, **{name: file[name] for name in file if name != "alternating"})
    more = render(cornell, "direct", size=SIZE, store=tmp_path, noise=1e-6, max_replicates=5)
    assert more.n == 5
    assert more.noise_sample is None
    assert (more.total >= whole.total).all()


@pytest.mark.parametrize("n", [6, 7])
def test_the_sample_of_the_noise_has_its_variance_and_no_mean(cornell: Scene, n: int) -> None:
    found = render(cornell, "one-bounce", size=(64, 48), noise=1e-6, max_replicates=n)
    sample, variance = found.noise_sample, found.variance
    assert sample is not None
    lit = variance > 0
    normal = sample[lit] / np.sqrt(variance[lit])
    # Replicates may change places, so on the average over orders the sample's square is 1 - (n odd)/n² of the variance, whatever
    # their distribution. For normal ones it has the standard deviation sqrt(2 (n-2)/(n+1)) ≤ 1.2, and over 3072 pixels, whose
    # channels move together, 0.022; 0.1 is over 4 of them.
    assert abs(float(normal.mean())) < 0.1
    assert float((normal**2).mean()) == pytest.approx(1 - n % 2 / n**2, abs=0.1)


def test_a_stored_reference_that_suffices_is_returned_untouched(
    cornell: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = render(cornell, "one-bounce", SIZE, noise=0.1, store=tmp_path)
    monkeypatch.setattr("renderers.reference.replicates._continued", lambda *a: pytest.fail("rendered again"))
    assert same(render(cornell, "one-bounce", SIZE, noise=0.2, store=tmp_path), first)


def test_the_picture_beside_the_sums_is_readable_by_others(cornell: Scene, tmp_path: Path) -> None:
    reference = render(cornell, "one-bounce", SIZE, noise=0.5, store=tmp_path)
    layers, attributes = read_exr(next(tmp_path.glob("*.exr")))
    np.testing.assert_array_equal(layers["mean"], reference.image)
    np.testing.assert_array_equal(layers[""], reference.image)
    np.testing.assert_array_equal(layers["variance"], reference.variance)
    np.testing.assert_array_equal(layers["luminance_variance"], reference.luminance_variance)
    assert attributes["n"] == "48"
    assert attributes["scene"] == cornell.hash
    assert attributes["transport"] == "one-bounce"


@pytest.mark.parametrize("damage", [b"", b"PK\x03\x04 not a zip", b"\x00" * 100])
def test_a_damaged_store_is_rendered_anew(cornell: Scene, tmp_path: Path, damage: bytes) -> None:
    first = render(cornell, "one-bounce", SIZE, noise=0.5, store=tmp_path)
    next(tmp_path.glob("*.npz")).write_bytes(damage)
    assert same(render(cornell, "one-bounce", SIZE, noise=0.5, store=tmp_path), first)


def test_fewer_replicates_never_replace_more(cornell: Scene, tmp_path: Path) -> None:
    long = render(cornell, "one-bounce", SIZE, noise=1e-9, max_replicates=50, store=tmp_path)
    parts = folder.identity(cornell.hash, 0, SIZE, "one-bounce", "centre", 64, None)
    folder.save(tmp_path, parts, replace(long, n=5))
    stored = folder.load(tmp_path, parts)
    assert stored is not None
    assert stored.n == 50


def test_each_part_of_the_identity_changes_the_key() -> None:
    base: tuple[object, ...] = ("a", 0, (4, 3), "full", "centre", 64, None)
    others = [("b", 0, (4, 3), "full", "centre", 64, None), ("a", 1, (4, 3), "full", "centre", 64, None)]
    others += [("a", 0, (3, 4), "full", "centre", 64, None), ("a", 0, (4, 3), "direct", "centre", 64, None)]
    others += [("a", 0, (4, 3), "full", "box", 64, None), ("a", 0, (4, 3), "full", "centre", 256, None)]
    others += [("a", 0, (4, 3), "full", "centre", 64, 0.5)]  # type: ignore[list-item]
    keys = {folder.key_of(folder.identity(*parts)) for parts in [base, *others]}  # type: ignore[arg-type]
    assert len(keys) == 8


@pytest.mark.parametrize(("caps", "said"), [({"max_replicates": 5}, "5 replicates"), ({"max_seconds": 0.0}, "0 s")])
def test_a_cap_is_named(cornell: Scene, caps: dict[str, float], said: str) -> None:
    reference = render(cornell, "full", SIZE, noise=1e-6, **caps)  # type: ignore[arg-type]
    assert 2 <= reference.n < 48
    assert f"stopped at {said} with noise" in reference.notes[0]
    assert "asked 1e-06" in reference.notes[0]


def test_two_processes_agree_to_the_byte(cornell: Scene) -> None:
    code = (
        "import renderers.reference as r, renderers, hashlib;"
        "x = r.render(renderers.load_scene('cornell-box'), 'full', (16, 12), noise=1e-6, max_replicates=2);"
        "print(hashlib.sha256(x.total.tobytes() + x.squares.tobytes()).hexdigest())"
    )
    runs = [subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout for _ in range(2)]
    assert runs[0] == runs[1]


def test_the_box_filter_differs_from_the_centre_only_where_pixels_hold_edges(cornell: Scene) -> None:
    centre = render(cornell, "direct", (32, 24), noise=0.5)
    box = render(cornell, "direct", (32, 24), noise=0.5, pixel="box")
    assert centre.noise < 1e-6
    assert box.noise > 1e-4
    change = np.abs(luminance(centre.image) - luminance(box.image))
    assert np.median(change) < 0.01 * luminance(box.image).mean()
    assert change.max() > 0.1 * luminance(box.image).mean()


def floor(environment: Environment | None = None, light: bool = False, geometry: bool = True) -> Scene:
    b = SceneBuilder("floor")
    if geometry:
        b.quad([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], b.material(Lambert()))
    if light:
        b.light(PointLight(), (0, 1, 0))
    b.environment = environment
    b.camera((0, 1, 2), (0, 0, 0), 1.5)
    return b.build()


@pytest.mark.parametrize("transport", renderers.TRANSPORTS)
def test_scenes_without_geometry_are_refused(transport: renderers.Transport) -> None:
    with pytest.raises(renderers.SceneError, match="no geometry"):
        render(floor(light=True, geometry=False), transport, SIZE, noise=0.01)


@pytest.mark.parametrize("transport", ["direct", "one-bounce", "one-bounce-unoccluded", "full"])
def test_scenes_without_light_are_black_with_a_note(transport: renderers.Transport) -> None:
    reference = render(floor(), transport, SIZE, noise=0.01)
    assert not reference.image.any()
    assert reference.noise == 0.0
    assert "black" in reference.notes[0]
    assert exposure(reference) == 1.0


def test_ambient_occlusion_needs_no_light_and_keeps_the_background_black() -> None:
    reference = render(floor(), "ambient-occlusion", SIZE, noise=0.01)
    np.testing.assert_allclose(reference.image[reference.surface], 1.0)
    assert not reference.image[~reference.surface].any()


def test_the_sky_is_seen_but_is_no_surface() -> None:
    reference = render(floor(Environment((2.0, 1.0, 0.5))), "full", SIZE, noise=0.1)
    sky = ~reference.surface
    assert sky.any()
    np.testing.assert_allclose(reference.image[sky], np.broadcast_to([2, 1, 0.5], reference.image[sky].shape), rtol=1e-6)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"transport": "fast"}, "unknown transport 'fast'"),
        ({"size": (0, 4)}, "size"),
        ({"noise": 0.0}, "noise"),
        ({"noise": float("nan")}, "noise"),
        ({"pixel": "corner"}, "pixel"),
        ({"max_replicates": 1}, "max_replicates"),
        ({"spp": 100}, "spp"),
        ({"radius": 1.0}, "radius"),
    ],
)
def test_arguments_out_of_range_are_refused(cornell: Scene, arguments: dict[str, object], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        render(cornell, **{"transport": "full", "size": SIZE, **arguments})  # type: ignore[arg-type]


def test_intervals_are_students_t(cornell: Scene) -> None:
    reference = render(cornell, "full", SIZE, noise=1.0)
    low, high = reference.interval()
    half = (high - low) / 2
    np.testing.assert_allclose(half, 2.0117405 * np.sqrt(reference.luminance_variance), rtol=1e-6)
    np.testing.assert_allclose((low + high) / 2, luminance(reference.total) / 48, rtol=1e-12)
    with pytest.raises(ValueError, match="level"):
        reference.interval(1.0)


def test_exposure_is_one_over_the_99th_percentile_of_surfaces(cornell: Scene) -> None:
    reference = render(cornell, "full", SIZE, noise=1.0)
    y = np.sort(luminance(reference.image)[reference.surface])
    assert 1 / exposure(reference) == pytest.approx(np.percentile(y, 99))
    assert y[0] < 1 / exposure(reference) <= y[-1]
