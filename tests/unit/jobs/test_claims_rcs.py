"""The claims about radiance cache splatting: what they are made of, without the long renders."""

from pathlib import Path

import numpy as np
import pytest

import renderers
from jobs.claims import radiance_system
from jobs.claims.radiance_system import RadianceScene, RadianceUnavailable
from jobs.claims.rcs_tables import Truth
from jobs.claims.registry import registered_claims


def test_the_table_is_registered() -> None:
    assert "rcs-table-4.2" in registered_claims()


def test_noise_of_the_reference_is_subtracted() -> None:
    """An image that is the truth has no error, whatever the noise of the reference; one that is off by 0.1 has 0.1."""
    rng = np.random.default_rng(1)
    truth = Truth(1 + rng.normal(0, 0.3, (200, 200, 3)), np.full((200, 200, 3), 0.09))
    # the mean of 120,000 squares of variance 0.09 has the standard error 0.09 √(2 / 120000) = 4e-4
    assert truth.rmse(np.ones((200, 200, 3))) ** 2 < 1.2e-3
    assert truth.rmse(np.full((200, 200, 3), 1.1)) == pytest.approx(0.1, abs=0.01)


def test_missing_programs_are_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(radiance_system, "find_spec", lambda name: None)
    with pytest.raises(RadianceUnavailable, match="pyradiance"):
        RadianceScene(renderers.load_scene("cornell-box").world(), tmp_path)


def test_rpict_sees_what_we_see(tmp_path: Path) -> None:
    """Direct light of the box: the same picture where neighbouring pixels agree, to three digits."""
    pytest.importorskip("pyradiance", reason="Radiance's programs come with the developers' extra")
    from renderers.transport.direct import direct
    from renderers.transport.primary import cast_gbuffer

    world = renderers.load_scene("cornell-box").world()
    theirs = RadianceScene(world, tmp_path).image((48, 48), 0)
    gbuffer = cast_gbuffer(world, (48, 48))
    ours = direct(world, gbuffer)
    apart = np.abs(theirs - ours).max(axis=2) > 2e-3 * ours.max(axis=2) + 1e-5
    assert apart.mean() < 0.02  # pixels whose ray grazes an edge or the rim of a shadow
    assert theirs.mean() == pytest.approx(ours.mean(), rel=0.01)
