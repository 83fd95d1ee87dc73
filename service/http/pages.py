"""Pages for people: plain HTML from templates, a little JavaScript from files, the report's own style sheet."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any
from urllib.parse import quote

from fastapi import APIRouter, Query, Request
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from starlette.exceptions import HTTPException
from starlette.responses import HTMLResponse, RedirectResponse, Response

import reports
from jobs.settings import limits
from renderers import UnknownMethod, get_method, registered_methods
from renderers.scene.model import NEEDS
from reports import format as form
from reports.regression_page import context
from service.describe import method_document
from service.http import problems
from service.http.access import COOKIE, Read, bearer
from service.http.matrix import matrix
from service.http.models import links, summary
from service.http.negotiation import choose
from service.http.problems import KINDS, Problem
from service.http.queue import ENDED
from service.http.routes.comparisons import all_runs, chosen
from service.http.routes.evaluations import Id
from service.http.routes.scenes import all_scenes
from service.http.site import Site, SiteOf

HERE = Path(__file__).parent
STATIC = HERE / "static"
REPORT_TEMPLATES = Path(reports.__file__).parent / "templates"
PER_PAGE = 25
MOST_CHOICES = 200
PAGE_WAIT_S = 3.0
Chosen = Annotated[str | None, Query(pattern=r"^[A-Za-z0-9._-]{0,64}$")]  # a form sends what wasn't chosen as an empty text
router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)
environment = Environment(
    loader=FileSystemLoader([HERE / "templates", REPORT_TEMPLATES]),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
environment.filters |= {"number": form.number, "percent": form.percent, "seconds": form.seconds, "limits": limits}
environment.filters["setting"] = lambda value: "none" if value is None else str(value)
environment.filters["url"] = lambda text: quote(text, safe="")


def render(request: Request, template: str, status: int = 200, **context: Any) -> HTMLResponse:
    """A page. Every template knows whether the visitor has logged in, and where it stands."""
    page = environment.get_template(template)
    return HTMLResponse(page.render(logged_in=COOKIE in request.cookies, path=request.url.path, **context), status)


@router.get("/", dependencies=[Read])
def overview(site: SiteOf, request: Request, cursor: Annotated[str | None, Query(max_length=500)] = None) -> HTMLResponse:
    """Evaluations, newest first, and how busy the service is."""
    try:
        found, following = site.queue.list(None, PER_PAGE, cursor)
    except ValueError as error:
        raise Problem("invalid-cursor", str(error)) from None
    night = next(iter(all_runs(site)), None) if cursor is None else None
    work = site.queue.stats()["queues"] if cursor is None else {}
    busy = {state: sum(queue[state] for queue in work.values()) for state in ("running", "queued")}
    items = [summary(s) for s in found]
    return render(request, "overview.html", items=items, following=following, first=cursor is None, night=night, busy=busy)


@router.get("/submit", dependencies=[Read])
def submit(site: SiteOf, request: Request) -> HTMLResponse:
    """A form made of the methods' JSON schemas."""
    methods = [method_document(method) for method in registered_methods().values()]
    return render(request, "submit.html", methods=methods, **_scenes(site))


@router.get("/evaluations/{id}", dependencies=[Read])
def evaluation(site: SiteOf, request: Request, id: Id) -> HTMLResponse:
    """One evaluation, its cells filling in while it runs."""
    status = site.evaluation(id)
    shown = summary(status)
    there = status.state in ENDED and site.queue.report_file(id, "index.html") is not None
    return render(
        request, "evaluation.html", evaluation=shown, matrix=matrix(status.cells), links=links(status, there),
        ended=status.state in ENDED, asked=shown.request.model_dump(mode="json"), failures=[c for c in status.cells if c.error],
    )  # fmt: skip


@router.get("/evaluations/{id}/matrix", dependencies=[Read])
def cells(site: SiteOf, request: Request, id: Id) -> HTMLResponse:
    """The part of the page that changes while an evaluation runs."""
    status = site.evaluation(id)
    return render(request, "matrix.html", evaluation=summary(status), matrix=matrix(status.cells))


@router.get("/scenes", dependencies=[Read])
def scenes(site: SiteOf, request: Request) -> HTMLResponse:
    """All scenes with previews; a form to upload one."""
    return render(request, "scenes.html", limit=site.settings.max_scene_bytes, **_scenes(site))


@router.get("/methods", dependencies=[Read])
def methods(request: Request) -> HTMLResponse:
    """All methods and how they meet each need of a scene."""
    found = [method_document(method) for method in registered_methods().values()]
    return render(request, "methods.html", methods=found, needs=NEEDS)


@router.get("/methods/{name}", dependencies=[Read])
def method(request: Request, name: str) -> HTMLResponse:
    """One method's settings and claims."""
    try:
        found = get_method(name)
    except UnknownMethod as error:
        raise Problem("not-found", str(error)) from None
    return render(request, "method.html", method=method_document(found), needs=NEEDS)


@router.get("/compare", dependencies=[Read])
def comparison(site: SiteOf, request: Request, a: Chosen = None, b: Chosen = None) -> HTMLResponse:
    """What changed between two nightly runs or evaluations; by default between the accepted run and the latest one."""
    a, b = a or None, b or None
    runs = all_runs(site)
    ended = [summary(s) for s in site.queue.list(None, MOST_CHOICES, None)[0] if s.state in ENDED]
    choices: dict[str, Any] = {"runs": runs[:MOST_CHOICES], "evaluations": ended, "a": a, "b": b}
    if (b is None and not runs) or (a is None and b is not None and all(run.id != b for run in runs)):
        return render(request, "compare.html", **choices, made=None, note="")
    before, after = chosen(site, a, b)
    choices |= {"a": None if before is None else before.id, "b": after.id}
    try:
        made = site.comparisons.made(before, after, PAGE_WAIT_S)
    except Problem as problem:
        if problem.name != "not-ready":
            raise
        page = render(request, "compare.html", **choices, made=None, note="being made")
        page.headers["refresh"] = "2"
        return page
    run = next((run for run in runs if run.id == after.id), None)
    shown = context(made.comparison, made.viewers)
    return render(request, "compare.html", **choices, **shown, made=made, run=run, assets=made.assets, note="")


@router.get("/problems")
def kinds(request: Request) -> HTMLResponse:
    """All kinds of problems."""
    return render(request, "problems.html", kinds=KINDS)


@router.get("/problems/{name}")
def kind(request: Request, name: str) -> HTMLResponse:
    """One kind: what a problem's `type` leads to."""
    if name not in KINDS:
        raise Problem("not-found", f"no kind of problem {name!r}")
    return render(request, "problem.html", name=name, kind=KINDS[name], detail=None)


@router.get("/login")
def login_form(request: Request, next: str = "/") -> HTMLResponse:
    """A form for a token."""
    return render(request, "login.html", next=_local(next), wrong=False)


@router.post("/login", response_model=None)
async def login(site: SiteOf, request: Request) -> Response:
    """Keep the token in a cookie that scripts can't read and other sites can't send."""
    async with request.form(max_files=0, max_fields=4) as fields:
        token, following = str(fields.get("token", "")).strip(), _local(str(fields.get("next", "/")))
    if site.tokens.find(token) is None:
        return render(request, "login.html", 401, next=following, wrong=True)
    answer = RedirectResponse(following, 303)
    answer.set_cookie(COOKIE, token, max_age=30 * 86400, httponly=True, samesite="strict", secure=request.url.scheme == "https")
    return answer


@router.post("/logout", response_model=None)
def logout() -> Response:
    """Forget the token."""
    answer = RedirectResponse("/login", 303)
    answer.delete_cookie(COOKIE, httponly=True, samesite="strict")
    return answer


def or_problem(request: Request, error: Exception) -> Response:
    """An error as a page where a person asked for a page, else as a problem document."""
    answer = problems.of_http_exception(request, error)
    if request.url.path.startswith("/v1/") or not _wants_page(request):
        return answer
    if answer.status_code == 401 and request.method == "GET" and bearer(request) is None:
        return RedirectResponse(f"/login?next={quote(request.url.path)}", 303)
    document = json.loads(bytes(answer.body))
    name = document["type"].removeprefix("/problems/")
    page = render(request, "problem.html", answer.status_code, name=name, kind=KINDS[name], detail=document["detail"])
    page.headers.update({k: v for k, v in answer.headers.items() if k not in ("content-length", "content-type")})
    return page


def _scenes(site: Site) -> dict[str, Any]:
    """All scenes, and the names of those whose previews are there."""
    found = all_scenes(site)
    return {"scenes": found, "drawn": site.thumbnails.drawn(scene.name for scene in found)}


def _wants_page(request: Request) -> bool:
    try:
        return choose(request.headers.get("accept"), (problems.MEDIA_TYPE, "text/html")) == "text/html"
    except HTTPException:
        return False


def _local(address: str) -> str:
    """A path of this service, whatever was asked for."""
    plain = address.startswith("/") and not address.startswith(("//", "/\\")) and address.isprintable()
    return address if plain else "/"
