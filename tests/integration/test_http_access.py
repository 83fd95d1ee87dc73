"""Tokens, scopes, rates, names and origins: who gets in."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from http_service import HEALTHY, FakeQueue, serving
from test_http_api import BODY, problem

from service.http.app import create_app
from service.http.logs import JsonFormatter
from service.http.settings import ServerSettings
from service.tokens import TokenStore

pytestmark = pytest.mark.usefixtures("toy_methods")


@pytest.fixture
def home(tmp_path: Path) -> Path:
    return tmp_path / "home"


@pytest.fixture
def address(home: Path, toy_methods: None) -> Iterator[str]:
    settings = ServerSettings(home=home, require_token=True, requests_per_s=0, submissions_per_s=0)
    with serving(create_app(FakeQueue(), settings, machine=lambda: HEALTHY)) as found:
        yield found


def ask(address: str, method: str, path: str, token: str | None = None, **more: object) -> httpx.Response:
    headers = {} if token is None else {"authorization": f"Bearer {token}"}
    return httpx.request(method, address + path, headers=headers, timeout=20, **more)  # type: ignore[arg-type]


def test_scopes(address: str, home: Path) -> None:
    store = TokenStore(home / "tokens.json")
    tokens = {scope: store.add(f"the {scope} one", scope)[1] for scope in ("read", "submit", "admin")}
    wanted = [
        ("GET", "/v1/evaluations", "read", {}),
        ("GET", "/v1/methods", "read", {}),
        ("GET", "/metrics", "read", {}),
        ("POST", "/v1/evaluations", "submit", {"json": BODY}),
        ("DELETE", "/v1/evaluations/0000000000000000", "submit", {}),
        ("POST", "/v1/evaluations/0000000000000000/retry", "submit", {}),
        ("POST", "/v1/scenes", "submit", {}),
        ("DELETE", "/v1/scenes/nosuch", "admin", {}),
    ]
    order = ("read", "submit", "admin")
    for method, path, scope, more in wanted:
        refused = ask(address, method, path, **more)
        problem(refused, "unauthorized")
        assert refused.headers["www-authenticate"].startswith("Bearer")
        problem(ask(address, method, path, "lux_guess", **more), "unauthorized")
        for held in order:
            answer = ask(address, method, path, tokens[held], **more)
            if order.index(held) < order.index(scope):
                assert f"scope {scope}" in problem(answer, "forbidden")["detail"]
            else:
                assert answer.status_code not in (401, 403), (method, path, held)


def test_the_door_stays_shut_without_any_token(address: str) -> None:
    problem(ask(address, "GET", "/v1/evaluations"), "unauthorized")
    for path in ("/healthz", "/readyz", "/problems", "/login", "/static/pages.css"):
        assert ask(address, "GET", path).status_code in (200, 503)


def test_a_revoked_token_stops_at_once(address: str, home: Path) -> None:
    store = TokenStore(home / "tokens.json")
    kept, secret = store.add("someone", "read")
    assert ask(address, "GET", "/v1/methods", secret).status_code == 200
    store.revoke(kept.id)
    problem(ask(address, "GET", "/v1/methods", secret), "unauthorized")


def test_tokens_are_kept_as_hashes_for_their_owner_only(home: Path) -> None:
    store = TokenStore(home / "tokens.json")
    kept, secret = store.add("someone", "read")
    assert secret not in store.path.read_text()
    assert store.path.stat().st_mode & 0o077 == 0
    assert store.find(secret) == kept
    assert store.find(secret + "x") is None
    assert len(secret) > 40


def test_browsers_log_in_with_a_cookie(address: str, home: Path) -> None:
    _, secret = TokenStore(home / "tokens.json").add("someone", "submit")
    with httpx.Client(base_url=address, headers={"accept": "text/html"}) as browser:
        away = browser.get("/scenes")
        assert (away.status_code, away.headers["location"]) == (303, "/login?next=/scenes")
        assert browser.post("/login", data={"token": "lux_guess", "next": "/scenes"}).status_code == 401
        inside = browser.post("/login", data={"token": secret, "next": "/methods"})
        assert (inside.status_code, inside.headers["location"]) == (303, "/methods")
        cookie = inside.headers["set-cookie"].lower()
        assert "httponly" in cookie
        assert "samesite=strict" in cookie
        assert browser.get("/methods").status_code == 200
        for elsewhere in ("//evil.example", "https://evil.example", "/\\evil.example", "javascript:alert(1)"):
            found = browser.post("/login", data={"token": secret, "next": elsewhere})
            assert found.headers["location"] == "/"
        assert browser.post("/logout").status_code == 303
        assert browser.get("/methods").status_code == 303


def test_other_sites_and_other_names_are_refused(home: Path) -> None:
    settings = ServerSettings(home=home, hosts=("127.0.0.1", "localhost"), requests_per_s=0, submissions_per_s=0)
    with serving(create_app(FakeQueue(), settings, machine=lambda: HEALTHY)) as address:
        problem(httpx.get(f"{address}/v1/methods", headers={"host": "rebound.example"}), "misdirected")
        problem(httpx.get(f"{address}/v1/methods", headers={"host": "[::1"}), "misdirected")
        for origin in ("http://evil.example", "null", "http://127.0.0.1:1"):
            problem(httpx.post(f"{address}/v1/evaluations", json=BODY, headers={"origin": origin}), "foreign-origin")
        assert httpx.post(f"{address}/v1/evaluations", json=BODY, headers={"origin": address}, timeout=20).status_code == 202


def test_rates(home: Path) -> None:
    settings = ServerSettings(home=home, requests_per_s=1, request_burst=5, submissions_per_s=0.5, submission_burst=2)
    with serving(create_app(FakeQueue(), settings, machine=lambda: HEALTHY)) as address, httpx.Client(base_url=address) as client:
        answers = [client.post("/login", data={"token": "x"}).status_code for _ in range(2)]
        assert answers == [401, 401]
        limited = client.post("/login", data={"token": "x"})
        problem(limited, "too-many-requests")
        assert 1 <= int(limited.headers["retry-after"]) <= 2
        reads = [client.get("/problems").status_code for _ in range(4)]
        assert reads[:2] == [200, 200]
        assert reads[3] == 429
        assert client.get("/healthz").status_code == 200


def test_log_lines_are_json_with_the_evaluation(home: Path, caplog: pytest.LogCaptureFixture) -> None:
    settings = ServerSettings(home=home, requests_per_s=0, submissions_per_s=0)
    lines: list[str] = []

    class Keep(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            lines.append(JsonFormatter().format(record))

    logger = logging.getLogger("luxmeter.http")
    handler = Keep()
    logger.addHandler(handler)
    caplog.set_level(logging.INFO, "luxmeter.http")
    try:
        with serving(create_app(FakeQueue(), settings, machine=lambda: HEALTHY)) as address:
            answer = httpx.post(f"{address}/v1/evaluations", json=BODY, timeout=20)
            id = answer.json()["id"]
            httpx.get(f"{address}/v1/evaluations/{id}", headers={"authorization": "Bearer lux_secret"})
            httpx.get(f"{address}/v1/methods")
    finally:
        logger.removeHandler(handler)
    found = [json.loads(line) for line in lines]
    assert [(line["method"], line["status"], line.get("evaluation")) for line in found] == [
        ("POST", 202, id), ("GET", 200, id), ("GET", 200, None),
    ]  # fmt: skip
    assert found[0]["request"] == answer.headers["x-request-id"]
    assert not any("lux_secret" in line for line in lines)
