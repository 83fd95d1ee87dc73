"""Every route of the HTTP interface, over a real socket."""

from __future__ import annotations

import html
import io
import json
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pandas as pd
import pytest
from http_service import HEALTHY, FakeQueue, serving

from service.http.app import create_app
from service.http.problems import KINDS
from service.http.settings import ServerSettings

pytestmark = pytest.mark.usefixtures("toy_methods")
BODY = {"scenes": ["cornell-box"], "methods": [{"name": "flat", "sweep": {"level": [0.25, 0.5]}}], "size": [8, 6], "seeds": 2}
FREE = {"requests_per_s": 0, "submissions_per_s": 0, "poll_s": 0.02}


@pytest.fixture
def queue() -> FakeQueue:
    return FakeQueue()


@pytest.fixture
def client(queue: FakeQueue, tmp_path: Path, toy_methods: None) -> Iterator[httpx.Client]:
    app = create_app(queue, ServerSettings(home=tmp_path / "home", **FREE), machine=lambda: HEALTHY)
    with serving(app) as address, httpx.Client(base_url=address, timeout=20) as found:
        yield found


def submitted(client: httpx.Client, **changes: Any) -> str:
    answer = client.post("/v1/evaluations", json=BODY | changes)
    assert answer.status_code == 202, answer.text
    return str(answer.json()["id"])


def problem(answer: httpx.Response, name: str) -> dict[str, Any]:
    """The problem document of an answer, whose type leads to a page."""
    assert answer.headers["content-type"] == "application/problem+json"
    document: dict[str, Any] = answer.json()
    assert (document["type"], document["status"]) == (f"/problems/{name}", answer.status_code)
    assert answer.status_code == KINDS[name].status
    assert document["title"] == KINDS[name].title
    return document


def test_submission_is_accepted_once(client: httpx.Client, queue: FakeQueue) -> None:
    first = client.post("/v1/evaluations", json=BODY)
    assert first.status_code == 202
    document = first.json()
    assert first.headers["location"] == f"/v1/evaluations/{document['id']}"
    assert document["state"] == "queued"
    assert [(c["scene"], c["method"], c["seed"], c["state"]) for c in document["cells"]] == [
        ("cornell-box", "flat", seed, "queued") for _ in range(2) for seed in range(2)
    ]
    assert document["links"]["report"] is None
    again = client.post("/v1/evaluations", json=BODY | {"priority": 1})
    assert again.json()["id"] == document["id"]
    assert len(queue.found) == 1
    assert client.get(first.headers["location"]).json()["id"] == document["id"]


@pytest.mark.parametrize(
    ("changes", "name", "said"),
    [
        ({"scenes": ["/etc/passwd"]}, "unknown-scene", "/etc/passwd"),
        ({"scenes": ["../cornell-box.glb"]}, "unknown-scene", "cornell-box.glb"),
        ({"scenes": ["cornell-box:light=nothing"]}, "unknown-scene", "light"),
        ({"scenes": ["upload-" + "0" * 32]}, "unknown-scene", "upload-"),
        ({"methods": [{"name": "nosuch"}]}, "unknown-method", "nosuch"),
        ({"methods": [{"name": "flat", "settings": {"levle": 1}}]}, "invalid-request", "levle"),
        ({"methods": [{"name": "flat", "settings": {"level": 11}}]}, "invalid-request", "level"),
        ({"methods": [{"name": "flat", "sweep": {"level": [0.1] * 300, "subpixels": [1] * 300}}]}, "invalid-request", "180000"),
        ({"frames": [3, 1]}, "validation-failed", "backwards"),
        ({"size": [0, 5]}, "validation-failed", "#/size/0"),
        ({"extra": 1}, "validation-failed", "#/extra"),
    ],
)
def test_a_bad_submission_names_what_is_wrong(
    client: httpx.Client, queue: FakeQueue, changes: dict[str, Any], name: str, said: str
) -> None:
    answer = client.post("/v1/evaluations", json=BODY | changes)
    assert said in problem(answer, name)["detail"]
    assert queue.found == {}


def test_bodies_that_are_no_json(client: httpx.Client) -> None:
    json_type = {"content-type": "application/json"}
    problem(client.post("/v1/evaluations", content=b'{"scenes": [', headers=json_type), "bad-request")
    problem(client.post("/v1/evaluations", content=b"[" * 100_000, headers=json_type), "bad-request")
    problem(client.post("/v1/evaluations", content=b'"\x80"', headers=json_type), "bad-request")
    problem(client.post("/v1/evaluations", content=json.dumps(BODY), headers={"content-type": "text/plain"}), "validation-failed")
    surrogate = client.post("/v1/evaluations", content=json.dumps(BODY | {"scenes": ["\ud800"]}), headers=json_type)
    problem(surrogate, "unknown-scene")


def test_unknown_addresses_and_methods(client: httpx.Client) -> None:
    problem(client.get("/v1/nothing"), "not-found")
    problem(client.get("/v1/evaluations/0000000000000000"), "not-found")
    problem(client.get("/v1/evaluations/%20"), "validation-failed")
    answer = client.put("/v1/evaluations")
    problem(answer, "method-not-allowed")
    assert "POST" in answer.headers["allow"] or "GET" in answer.headers["allow"]


def test_every_kind_of_problem_has_a_page(client: httpx.Client) -> None:
    for name, kind in KINDS.items():
        page = client.get(f"/problems/{name}")
        assert page.status_code == 200
        assert kind.title in html.unescape(page.text)
    assert client.get("/problems/nosuch").status_code == 404
    assert all(name in client.get("/problems").text for name in KINDS)


def test_an_unexpected_error_tells_nothing_but_the_request_id(client: httpx.Client, queue: FakeQueue) -> None:
    id = submitted(client)
    queue.found[id] = None  # type: ignore[assignment]
    answer = client.get(f"/v1/evaluations/{id}")
    assert problem(answer, "internal-error")["detail"] == f"request {answer.headers['x-request-id']}"
    assert answer.headers["x-content-type-options"] == "nosniff"


def test_pages_follow_one_another(client: httpx.Client) -> None:
    made = [submitted(client, seeds=n) for n in range(1, 8)]
    for limit in (1, 2, 3, 7, 200):
        seen, cursor = [], None
        while True:
            page = client.get("/v1/evaluations", params={"limit": limit} | ({"cursor": cursor} if cursor else {})).json()
            assert len(page["items"]) <= limit
            seen += [item["id"] for item in page["items"]]
            cursor = page["next_cursor"]
            if cursor is None:
                break
        assert seen == made[::-1]
    problem(client.get("/v1/evaluations", params={"cursor": "nonsense"}), "invalid-cursor")
    problem(client.get("/v1/evaluations", params={"limit": 0}), "validation-failed")
    linked = client.get("/v1/evaluations?limit=2").links["next"]["url"]
    assert [item["id"] for item in client.get(linked).json()["items"]] == made[::-1][2:4]


def test_lists_can_be_filtered_by_state(client: httpx.Client, queue: FakeQueue) -> None:
    first, second = submitted(client), submitted(client, seeds=1)
    queue.set(first, "done")
    assert [i["id"] for i in client.get("/v1/evaluations?state=done").json()["items"]] == [first]
    assert [i["id"] for i in client.get("/v1/evaluations?state=queued").json()["items"]] == [second]
    problem(client.get("/v1/evaluations?state=odd"), "validation-failed")


def test_cancel_and_retry(client: httpx.Client, queue: FakeQueue) -> None:
    id = submitted(client)
    problem(client.post(f"/v1/evaluations/{id}/retry"), "conflict")
    assert client.delete(f"/v1/evaluations/{id}").json()["state"] == "cancelled"
    told = len(queue.told[id])
    assert client.delete(f"/v1/evaluations/{id}").json()["state"] == "cancelled"
    assert len(queue.told[id]) == told
    assert client.post(f"/v1/evaluations/{id}/retry").json()["state"] == "queued"
    problem(client.post("/v1/evaluations/0000000000000000/retry"), "not-found")
    problem(client.delete("/v1/evaluations/0000000000000000"), "not-found")


def read_stream(client: httpx.Client, id: str, **headers: str) -> list[tuple[str, dict[str, Any]]]:
    """All events of a stream to its end, as (id, data)."""
    found, last = [], ""
    with client.stream("GET", f"/v1/evaluations/{id}/events", headers=headers) as answer:
        assert answer.headers["content-type"].startswith("text/event-stream")
        for line in answer.iter_lines():
            if line.startswith("id: "):
                last = line[4:]
            if line.startswith("data: "):
                found.append((last, json.loads(line[6:])))
    return found


def test_a_stream_tells_everything_once_and_can_be_resumed(client: httpx.Client, queue: FakeQueue) -> None:
    id = submitted(client)
    work = threading.Timer(0.3, lambda: (queue.set(id, "done", only=0), queue.set(id, "done")))
    work.start()
    found = read_stream(client, id)
    work.join()
    assert [(key, data.get("seq")) for key, data in found] == [("1", 1), ("2", 2), ("3", 3), ("3", None)]
    assert found[-1][1] == {"state": "done"}
    assert read_stream(client, id, **{"Last-Event-ID": "2"}) == found[2:]
    assert client.get(f"/v1/evaluations/{id}/events?after=1", headers={"accept": "application/json"}).json() == {
        "events": [data for _, data in found[1:3]],
        "state": "done",
    }
    problem(client.get(f"/v1/evaluations/{id}/events", headers={"Last-Event-ID": "x"}), "validation-failed")


def test_polling_says_when_to_come_back(client: httpx.Client, queue: FakeQueue) -> None:
    id = submitted(client)
    for path in (f"/v1/evaluations/{id}", f"/v1/evaluations/{id}/events"):
        assert int(client.get(path, headers={"accept": "application/json"}).headers["retry-after"]) >= 1
    queue.set(id, "done")
    assert "retry-after" not in client.get(f"/v1/evaluations/{id}").headers


def test_results_in_three_formats(client: httpx.Client, queue: FakeQueue) -> None:
    id = submitted(client)
    queue.set(id, "done", only=0)
    address = f"/v1/evaluations/{id}/results"
    rows = client.get(address).json()
    assert (rows["id"], rows["state"], len(rows["results"])) == (id, "running", 1)
    csv = client.get(address, headers={"accept": "text/csv"})
    parquet = client.get(address, headers={"accept": "application/vnd.apache.parquet, application/json;q=0.1"})
    assert csv.headers["content-type"].startswith("text/csv")
    tables = pd.read_csv(io.BytesIO(csv.content)), pd.read_parquet(io.BytesIO(parquet.content))
    for table in tables:
        assert list(table["state"]) == ["done", "queued", "queued", "queued"]
        assert table["matched.rmse"].iloc[0] == 3.5
        assert table["matched.rmse"].isna().sum() == 3
    problem(client.get(address, headers={"accept": "image/png"}), "not-acceptable")


def test_report_files(client: httpx.Client, queue: FakeQueue, tmp_path: Path) -> None:
    id = submitted(client)
    address = f"/v1/evaluations/{id}/report"
    early = client.get(address)
    problem(early, "not-ready")
    assert int(early.headers["retry-after"]) >= 1
    queue.set(id, "done")
    problem(client.get(address), "conflict")
    (tmp_path / "report" / "assets").mkdir(parents=True)
    (tmp_path / "report" / "index.html").write_text('<html><head><link href="assets/report.css"></head></html>')
    (tmp_path / "report" / "assets" / "report.css").write_text("body {}")
    (tmp_path / "secret").write_text("secret")
    queue.folders[id] = tmp_path / "report"
    page = client.get(address)
    assert page.headers["content-type"] == "text/html; charset=utf-8"
    assert f'<base href="{address}/">' in page.text
    assert client.head(address).headers["content-length"] == str(len(page.content))
    assert "<base" not in client.get(f"{address}/").text
    style = client.get(f"{address}/assets/report.css")
    assert (style.text, style.headers["content-type"]) == ("body {}", "text/css; charset=utf-8")
    assert client.get(f"{address}/assets/report.css", headers={"if-none-match": style.headers["etag"]}).status_code == 304
    for escape in (
        "../secret",
        "..%2fsecret",
        "assets/../../secret",
        "%2e%2e/secret",
        "..%5csecret",
        "/etc/passwd",
        "assets//report.css",
    ):
        found = client.get(f"{address}/{escape}")
        assert found.status_code in (404, 422), escape
        assert found.text != "secret"


def test_artefacts_have_tags_and_ranges(client: httpx.Client, queue: FakeQueue) -> None:
    content = bytes(range(256)) * 4096
    id, hash = submitted(client), queue.keep(content)
    address = f"/v1/evaluations/{id}/artifacts/{hash}"
    whole = client.get(address)
    assert whole.content == content
    assert (whole.headers["etag"], whole.headers["accept-ranges"]) == (f'"{hash}"', "bytes")
    assert "immutable" in whole.headers["cache-control"]
    for header, part in (("bytes=0-9", content[:10]), ("bytes=1000-", content[1000:]), ("bytes=-7", content[-7:]),
                         ("bytes=5-99999999", content[5:])):  # fmt: skip
        found = client.get(address, headers={"range": header})
        assert (found.status_code, found.content) == (206, part)
        start = len(content) - len(part) if not header.startswith("bytes=0") else 0
        assert found.headers["content-range"] == f"bytes {start}-{start + len(part) - 1}/{len(content)}"
    for ignored in ("bytes=9-2", "lines=1-2", "bytes=0-1,5-6", "bytes=-"):
        assert client.get(address, headers={"range": ignored}).status_code == 200
    for beyond in (f"bytes={len(content)}-", "bytes=-0"):
        refused = client.get(address, headers={"range": beyond})
        problem(refused, "range-not-satisfiable")
        assert refused.headers["content-range"] == f"bytes */{len(content)}"
    assert client.get(address, headers={"range": "bytes=0-1", "if-range": '"other"'}).status_code == 200
    assert client.get(address, headers={"if-none-match": f'"x", W/"{hash}"'}).status_code == 304
    assert client.head(address).headers["content-length"] == str(len(content))
    problem(client.get(f"/v1/evaluations/{id}/artifacts/{'0' * 64}"), "not-found")
    problem(client.get(f"/v1/evaluations/{id}/artifacts/short"), "validation-failed")


def test_methods_show_their_schemas(client: httpx.Client) -> None:
    listed = {method["name"]: method for method in client.get("/v1/methods").json()["items"]}
    assert {"flat", "ir", "pt"} <= set(listed)
    flat = client.get("/v1/methods/flat").json()
    assert flat == listed["flat"]
    assert flat["settings"]["properties"]["level"]["maximum"] == 10
    assert flat["claims"]["environment"]["support"] == "refused"
    problem(client.get("/v1/methods/nosuch"), "not-found")


def test_health_readiness_and_metrics(client: httpx.Client, queue: FakeQueue) -> None:
    assert client.get("/healthz").json() == {"status": "ok"}
    for _ in range(200):
        answer = client.get("/readyz")
        if not answer.json()["checking"]:
            break
    assert answer.status_code == 200
    assert [c["name"] for c in answer.json()["conditions"]] == ["store", "queue", "OpenGL 4.3"]
    queue.stats = lambda: 1 / 0  # type: ignore[method-assign]
    answer = client.get("/readyz")
    assert answer.status_code == 503
    assert [c["ok"] for c in answer.json()["conditions"]] == [True, False, True]
    del queue.stats
    submitted(client)
    text = client.get("/metrics").text
    for line in (
        'luxmeter_queue_depth{queue="gl",state="queued"} 1.0',
        'luxmeter_queue_oldest_seconds{queue="gl"} 1.5',
        'luxmeter_method_seconds_total{method="ir",stage="render"} 12.5',
        'luxmeter_failures_total{kind="timeout"} 2.0',
        'luxmeter_http_requests_total{method="POST",route="/v1/evaluations",status="202"} 1.0',
    ):
        assert line in text


def test_every_answer_carries_the_security_headers(client: httpx.Client) -> None:
    for path in ("/", "/v1/methods", "/v1/nothing", "/static/pages.css", "/healthz"):
        headers = client.get(path).headers
        assert "script-src 'self'" in headers["content-security-policy"]
        assert "unsafe" not in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff"
        assert "server" not in headers


def test_openapi_is_served(client: httpx.Client) -> None:
    found = client.get("/openapi.json").json()
    assert found["openapi"].startswith("3.1")
    operations = [op for path in found["paths"].values() for op in path.values()]
    assert all("summary" in op for op in operations)
    body = found["paths"]["/v1/evaluations"]["post"]["requestBody"]["content"]["application/json"]
    assert set(body["examples"]) == {"two methods", "sweep with seeds", "sequence"}
