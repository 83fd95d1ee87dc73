"""A client of a running service. Errors of the service become RequestError (the request's fault) or ServiceError."""

from __future__ import annotations

import json
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import httpx

from jobs.errors import RequestError
from jobs.files import whole
from service.errors import ServiceError

WAIT_S = 60.0
LOOSE = ("evaluation.json", "results.csv", "results.parquet")


class Client:
    """Talks to the service at `address`, with a bearer token where one is given. Close it, or use it in a `with` block."""

    def __init__(self, address: str, token: str | None = None, transport: httpx.BaseTransport | None = None) -> None:
        headers = {} if token is None else {"authorization": f"Bearer {token}"}
        self.http = httpx.Client(base_url=address, headers=headers, timeout=WAIT_S, transport=transport)

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *error: object) -> None:
        self.http.close()

    def submit(self, request: dict[str, Any]) -> dict[str, Any]:
        """Submit an evaluation; the same request again answers the same one. Returns its state with its cells."""
        return self._document("POST", "/v1/evaluations", json=request)

    def status(self, id: str) -> dict[str, Any]:
        """State, progress and cells of an evaluation."""
        return self._document("GET", f"/v1/evaluations/{id}")

    def evaluations(self, state: str | None = None) -> Iterator[dict[str, Any]]:
        """All evaluations, newest first, without their cells."""
        cursor = None
        while True:
            wanted = {"state": state, "cursor": cursor}
            page = self._document("GET", "/v1/evaluations", params={key: value for key, value in wanted.items() if value})
            yield from page["items"]
            cursor = page["next_cursor"]
            if cursor is None:
                return

    def cancel(self, id: str) -> dict[str, Any]:
        """Cancel what is queued and running."""
        return self._document("DELETE", f"/v1/evaluations/{id}")

    def retry(self, id: str) -> dict[str, Any]:
        """Do again what failed or was cancelled."""
        return self._document("POST", f"/v1/evaluations/{id}/retry")

    def upload(self, path: Path, description: str = "") -> dict[str, Any]:
        """Upload a .glb file; the answer's `name` is what evaluations call the scene by."""
        headers = {"content-type": "model/gltf-binary"}
        with path.open("rb") as file:
            return self._document("POST", "/v1/scenes", params={"description": description}, headers=headers, content=file)

    def events(self, id: str, after: int = 0) -> Iterator[dict[str, Any]]:
        """Events as they happen, to the evaluation's end. A broken stream is taken up where it broke."""
        while True:
            try:
                headers = {"accept": "text/event-stream", "last-event-id": str(after)}
                with self.http.stream("GET", f"/v1/evaluations/{id}/events", headers=headers) as answer:
                    _check(answer)
                    for name, event in _parse(answer.iter_lines()):
                        if name == "end":
                            return
                        after = int(event["seq"])
                        yield event
            except (httpx.ReadTimeout, httpx.RemoteProtocolError):
                continue
            except httpx.TransportError as error:
                raise ServiceError(f"{self.http.base_url}: {error}") from None

    def results(self, id: str) -> list[dict[str, Any]]:
        """The results that there are."""
        found: list[dict[str, Any]] = self._document("GET", f"/v1/evaluations/{id}/results")["results"]
        return found

    def fetch(self, id: str, folder: Path) -> int:
        """Write the report and all that it shows into a folder; returns the number of files. Raises ServiceError before the end."""
        base = f"/v1/evaluations/{id}/report/"
        page = self._answer("GET", base).content
        found = ["index.html", *dict.fromkeys([*LOOSE, *linked_files(page.decode())])]
        for name in found:
            content = page if name == "index.html" else self._answer("GET", base + name).content
            with whole(folder / name) as temporary:
                temporary.write_bytes(content)
        return len(found)

    def _document(self, method: str, path: str, **more: Any) -> dict[str, Any]:
        document: dict[str, Any] = self._answer(method, path, **more).json()
        return document

    def _answer(self, method: str, path: str, **more: Any) -> httpx.Response:
        try:
            answer = self.http.request(method, path, **more)
        except httpx.TransportError as error:
            raise ServiceError(f"{self.http.base_url}: {error}") from None
        return _check(answer)


def _check(answer: httpx.Response) -> httpx.Response:
    """The answer where it is a good one. Raises RequestError or ServiceError with what the problem document says."""
    if answer.is_success:
        return answer
    answer.read()
    try:
        problem = answer.json()
        text = f"{problem['title']}: {problem['detail']}"
    except (ValueError, KeyError, TypeError):
        text = f"{answer.url}: HTTP {answer.status_code}"
    raise (RequestError if answer.status_code in (400, 404, 413, 415, 422) else ServiceError)(text)


def _parse(lines: Iterator[str]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Events of a server-sent event stream as (name, data)."""
    name, data = "message", ""
    for line in lines:
        key, _, value = line.partition(": ")
        if key == "event":
            name = value
        elif key == "data":
            data += value
        elif not line and data:
            yield name, json.loads(data)
            name, data = "message", ""


class _Links(HTMLParser):
    """Collects what a report links to within its own folder, and the images that its viewers load."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []
        self._viewer = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Addresses of links, scripts, pictures and style sheets."""
        given = dict(attrs)
        self.found += [
            unquote(v) for k in ("href", "src", "srcset") if (v := given.get(k)) and not v.startswith(("#", "data:", "/"))
        ]
        self._viewer = tag == "script" and given.get("type") == "application/json"

    def handle_endtag(self, tag: str) -> None:
        """A viewer's data ends with its script."""
        self._viewer = False

    def handle_data(self, data: str) -> None:
        """Each image of a viewer has a file of floats, a thumbnail, and its method's diagnostic pictures."""
        if self._viewer:
            for image in (image for frame in json.loads(data)["frames"] for image in frame["images"]):
                self.found += [f"assets/data/{image['id']}.js", f"assets/thumbnails/{image['id']}.png"]
                self.found += [f"assets/pictures/{picture['file']}" for picture in image.get("pictures", [])]


def linked_files(page: str) -> list[str]:
    """Files below the report's folder that its page needs. Raises ServiceError for one outside of it."""
    links = _Links()
    links.feed(page)
    for name in links.found:
        if ":" in name or "\\" in name or ".." in name.split("/"):
            raise ServiceError(f"the report links to {name!r}, outside of its folder")
    return links.found
