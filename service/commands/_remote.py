"""`luxmeter submit | status | cancel | retry | fetch`: the queue of a running service."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from jobs.errors import RequestError
from service.commands._evaluate import build
from service.options import Force, Frames, Json, Out, Quiet, References, Size
from service.output import console, print_json, print_table, staged

if TYPE_CHECKING:
    from service.client import Client

Server = Annotated[str, typer.Option(envvar="LUXMETER_SERVER", help="Address of the service.")]
TokenOption = Annotated[str | None, typer.Option("--token", envvar="LUXMETER_TOKEN", help="Bearer token.", show_envvar=True)]
Id = Annotated[str, typer.Argument(metavar="ID", help="Id of an evaluation.")]
LOCAL = "http://127.0.0.1:8000"


def submit(
    scene: Annotated[list[str], typer.Option(help="A scene; a .glb file is uploaded. Repeat for more.")],
    method: Annotated[list[str], typer.Option(help="A method; repeat for more.")],
    settings: Annotated[list[str] | None, typer.Option("--set", metavar="M.K=V", help="Setting K of method M.")] = None,
    sweep: Annotated[list[str] | None, typer.Option(metavar="M.K=A,B,…", help="Render M once for each value of K.")] = None,
    seeds: Annotated[int, typer.Option(help="Seeds 0 … N-1; two or more give intervals.")] = 1,
    size: Size = "320x180",
    frames: Frames = "0:0",
    references: References = None,
    noise: Annotated[float, typer.Option(help="Wanted relative noise of the references.")] = 0.01,
    priority: Annotated[int, typer.Option(min=0, max=9, help="0 comes first.")] = 5,
    wait: Annotated[bool, typer.Option("--wait", help="Come back when it has ended.")] = False,
    server: Server = LOCAL,
    token: TokenOption = None,
    quiet: Quiet = False,
    json: Json = False,
) -> int:
    """Submit an evaluation to a service; prints its id. Exit code 1 where --wait is given and cells failed."""
    request = build(
        scene, method, settings or [], sweep or [], size=size, seeds=seeds, frames=frames, references=references, noise=noise
    )
    with connect(server, token) as client:
        named = [_uploaded(client, text) for text in scene]
        document = client.submit(request.model_dump(mode="json") | {"scenes": named, "priority": priority})
        if wait:
            for event in client.events(document["id"]):
                _tell(event, quiet)
            document = client.status(document["id"])
    if json:
        print_json(document)
    else:
        print(document["id"])
    return 1 if wait and document["state"] != "done" else 0


def status(
    id: Annotated[str | None, typer.Argument(metavar="[ID]", help="Id of an evaluation; none lists them all.")] = None,
    server: Server = LOCAL,
    token: TokenOption = None,
    json: Json = False,
) -> None:
    """Show an evaluation's state and cells, or list all evaluations."""
    with connect(server, token) as client:
        document: Any = client.status(id) if id is not None else list(client.evaluations())
    if json:
        print_json(document)
    elif id is None:
        print_table(("evaluation", "state", "steps", "submitted", "scenes"), [_line(item) for item in document])
    else:
        print_table(("evaluation", "state", "steps", "submitted", "scenes"), [_line(document)])
        cells = [(c["scene"], c["label"], str(c["seed"]), str(c["frame"]), c["state"], c["error"] or "") for c in document["cells"]]
        print()
        print_table(("scene", "method", "seed", "frame", "state", "error"), cells)


def cancel(id: Id, server: Server = LOCAL, token: TokenOption = None, json: Json = False) -> None:
    """Cancel what is queued and running of an evaluation."""
    with connect(server, token) as client:
        _show_state(client.cancel(id), json)


def retry(id: Id, server: Server = LOCAL, token: TokenOption = None, json: Json = False) -> None:
    """Do again what failed or was cancelled of an evaluation."""
    with connect(server, token) as client:
        _show_state(client.retry(id), json)


def fetch(id: Id, out: Out, server: Server = LOCAL, token: TokenOption = None, force: Force = False, json: Json = False) -> None:
    """Download an evaluation's report with its images and results into OUT."""
    with connect(server, token) as client, staged(out, force=force) as folder:
        count = client.fetch(id, folder)
    if json:
        print_json({"id": id, "files": count, "report": str(out / "index.html")})
    else:
        print(out / "index.html")


def connect(server: str, token: str | None) -> Client:
    """A client of the service at that address."""
    from service.client import Client

    if not server.startswith(("http://", "https://")):
        raise RequestError(f"--server takes an address such as {LOCAL} (got {server!r})")
    return Client(server, token)


def _uploaded(client: Client, text: str) -> str:
    """The name of a scene on the service: a .glb file is uploaded first, anything else is a name already."""
    path = Path(text)
    if path.suffix.lower() != ".glb":
        return text
    if not path.is_file():
        raise RequestError(f"no file {text}")
    return str(client.upload(path, path.stem)["name"])


def _tell(event: dict[str, Any], quiet: bool) -> None:
    if not quiet and event.get("type") != "progress":
        words = [str(event[key]) for key in ("node", "state", "error") if event.get(key)]
        console.print(" ".join(words), markup=False, highlight=False)


def _line(document: dict[str, Any]) -> tuple[str, ...]:
    steps = f"{document['progress']['done']} of {document['progress']['total']}"
    return document["id"], document["state"], steps, document["created"], ", ".join(document["request"]["scenes"])


def _show_state(document: dict[str, Any], json: bool) -> None:
    if json:
        print_json(document)
    else:
        print(f"{document['id']} {document['state']}")
