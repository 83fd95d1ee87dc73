"""Nightly runs, and what changed between two runs or evaluations."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query
from fastapi import Path as InPath
from starlette.responses import FileResponse, Response

from reports.regression_page import headline
from service.http.access import Read
from service.http.comparisons import Made
from service.http.files import media_type
from service.http.models import ComparisonLinks, ComparisonView, RowImages, RunList, RunView
from service.http.problems import Problem, documented
from service.http.site import Site, SiteOf
from service.http.sources import Source

router = APIRouter(prefix="/v1", tags=["comparisons"])
WAIT_S = 20.0
ID = r"^[A-Za-z0-9._-]{1,64}$"
A = Annotated[str | None, Query(pattern=ID, description="Before: a nightly run or an evaluation; the accepted run where left out.")]
B = Annotated[str | None, Query(pattern=ID, description="After: a nightly run or an evaluation; the latest run where left out.")]


@router.get(
    "/runs", dependencies=[Read], responses=documented("unauthorized", "forbidden", "validation-failed", "too-many-requests")
)
def runs(
    site: SiteOf,
    limit: Annotated[int, Query(ge=1, le=200, description="Most items of a page.")] = 50,
    cursor: Annotated[str | None, Query(pattern=ID, description="`next_cursor` of the page before.")] = None,
) -> RunList:
    """Nightly runs, latest first."""
    known = all_runs(site)
    start = next((k + 1 for k, run in enumerate(known) if run.id == cursor), 0 if cursor is None else len(known))
    page = known[start : start + limit]
    return RunList(items=page, next_cursor=page[-1].id if start + limit < len(known) else None)


@router.get(
    "/comparisons",
    dependencies=[Read],
    responses=documented(
        "unauthorized", "forbidden", "not-found", "not-ready", "conflict", "validation-failed", "too-many-requests", "unavailable"
    ),
)
def comparison(site: SiteOf, a: A = None, b: B = None) -> ComparisonView:
    """What changed from a to b: every row with its verdict, errors paired over seeds, work counts and times, gravest first."""
    before, after = chosen(site, a, b)
    return view(before, after, site.comparisons.made(before, after, WAIT_S))


@router.get("/comparisons/{key}/{path:path}", dependencies=[Read], response_model=None, include_in_schema=False)
def file(site: SiteOf, key: Annotated[str, InPath(max_length=32)], path: str) -> Response:
    """An image of a comparison."""
    found = site.comparisons.file(key, path)
    if found is None:
        raise Problem("not-found", f"no file {path[:200]!r} of a comparison {key}")
    return FileResponse(found, media_type=media_type(path), headers={"cache-control": "private, max-age=86400"})


def chosen(site: Site, a: str | None, b: str | None) -> tuple[Source | None, Source]:
    """The two sides, by default the accepted and the latest run. Raises Problem where one can't be found."""
    after = site.sources.latest() if b is None else site.sources.find(b)
    return (site.sources.before(after) if a is None else site.sources.find(a)), after


def all_runs(site: Site) -> list[RunView]:
    """Every nightly run, latest first."""
    found = site.sources.runs()
    accepted = {suite: site.sources.accepted(suite) for suite in {run.suite for run in found}}
    return [
        RunView(**dict(run), accepted=(own := accepted[run.suite]) is not None and own.id == run.id, page=f"/compare?b={run.id}")
        for run in found
    ]


def view(before: Source | None, after: Source, made: Made) -> ComparisonView:
    """The document of a comparison."""
    images = {
        key: [
            RowImages(
                frame=frame["frame"], difference=f"{made.assets}/thumbnails/{frame['difference']}.png",
                **{name: f"{made.assets}/thumbnails/{image['id']}.png" for name, image in _named(frame["images"]).items()},
            )
            for frame in viewer["frames"]
        ]
        for key, viewer in made.viewers.items()
    }  # fmt: skip
    a = None if before is None else before.id
    page = f"/compare?b={after.id}" if a is None else f"/compare?a={a}&b={after.id}"
    return ComparisonView(
        **dict(made.comparison),
        a=a,
        b=after.id,
        headline=headline(made.comparison),
        images=images,
        links=ComparisonLinks(page=page),
    )


def _named(images: list[dict[str, str]]) -> dict[str, dict[str, str]]:
    """Images of a frame by what they are: the later one comes first, then the earlier one and the reference."""
    return dict(zip(("after", "before", "reference"), images, strict=False))
