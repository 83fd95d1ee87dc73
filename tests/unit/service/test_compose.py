"""The compose file holds together: what it names exists, nothing runs as root or listens to the world."""

from __future__ import annotations

from pathlib import Path

import pytest

from service.cli import run

ROOT = Path(__file__).parents[3]


def test_compose_file(capsys: pytest.CaptureFixture[str]) -> None:
    yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")
    found = yaml.safe_load((ROOT / "docker" / "compose.yaml").read_text())
    services = found["services"]
    assert set(services) == {"service", "worker", "database"}
    assert services["worker"]["deploy"]["replicas"] == 2
    for name, service in services.items():
        for volume in service["volumes"]:
            assert volume.split(":")[0] in found["volumes"], name
        for other in service.get("depends_on", {}):
            assert "healthcheck" in services[other], name
    for name in ("service", "worker"):
        build = services[name]["build"]
        assert (ROOT / "docker" / build["context"] / build["dockerfile"]).resolve() == ROOT / "docker" / "Dockerfile"
        assert run([services[name]["command"][0], "--help"]) == 0
    assert all(port.startswith("127.0.0.1:") for port in services["service"]["ports"])
    assert "--no-worker" in capsys.readouterr().out


def test_dockerfile_ends_without_root() -> None:
    lines = (ROOT / "docker" / "Dockerfile").read_text().splitlines()
    assert "USER luxmeter" in lines
    copied = [line.split()[1] for line in lines if line.startswith("COPY")]
    assert all((ROOT / name).exists() for name in copied)
