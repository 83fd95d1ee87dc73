"""The claims about bases of the hemisphere: their figures against independent quadrature, and their words."""

from types import SimpleNamespace
from typing import Any

import pytest

from jobs.claims import hsh_bases
from jobs.claims.hsh_bases import ORDERS, phong_lobe, ringing, shares, ward_lobe
from jobs.claims.registry import registered_claims
from renderers.transport.hemispherical.comparison import Basis
from renderers.transport.hemispherical.models import phong, ward

SILENT: Any = SimpleNamespace(report=lambda text: None)


def test_the_claims_are_registered() -> None:
    assert {"hsh-figure-3.9", "hsh-figure-3.10", "hsh-figure-3.11", "rcs-cornell-glossy"} <= set(registered_claims())


@pytest.mark.parametrize(
    ("basis", "angle", "expected"),
    [
        ("hemispherical", 30, (0.7686, 0.9653, 0.9980, 0.9999)),
        ("spherical", 30, (0.4879, 0.7869, 0.9431, 0.9916)),
        ("even", 45, (0.6044, 0.8922, 0.9879, 0.9987)),
        ("zernike", 60, (0.6356, 0.8508, 0.9731, 0.9943)),
    ],
)
def test_shares_of_the_phong_lobe(basis: Basis, angle: int, expected: tuple[float, ...]) -> None:
    """Figures of an independent quadrature of 200 × 400 nodes, printed to four digits."""
    assert shares(phong(5.0), basis, [angle])[0, :4] == pytest.approx(expected, abs=2e-3)


def test_shares_of_the_anisotropic_lobe_at_a_grazing_view() -> None:
    """At 60° spherical harmonics of order 7 overtake hemispherical ones: 0.8520 and 0.8500."""
    column = ORDERS.index(7)
    ours, theirs = (shares(ward(0.2, 0.5), basis, [60])[0, column] for basis in ("hemispherical", "spherical"))  # type: ignore[arg-type]
    assert (ours, theirs) == pytest.approx((0.8500, 0.8520), abs=2e-3)


def test_what_the_figures_say(monkeypatch: pytest.MonkeyPatch) -> None:
    """Phong: better than spherical harmonics everywhere, than the others near the normal. Ward: than spherical ones mostly."""
    monkeypatch.setattr(hsh_bases, "MU_NODES", 48)
    monkeypatch.setattr(hsh_bases, "PHI_NODES", 96)
    phong_rows = {r.id: r.measured.mean for r in phong_lobe(SILENT).rows}
    assert phong_rows["beats.spherical"] == 1
    assert phong_rows["beats.even.near"] > phong_rows["beats.even"]
    ward_rows = {r.id: r.measured.mean for r in ward_lobe(SILENT).rows}
    assert 0.8 < ward_rows["beats.spherical"] < 1


def test_rings_are_shallower() -> None:
    """In the mean of the lobes; published in a picture, without figures."""
    rows = {r.id: r.measured.mean for r in ringing(SILENT).rows}
    assert rows["hemispherical.undershoot"] < rows["spherical.undershoot"]
    assert rows["hemispherical.error"] < rows["spherical.error"]
