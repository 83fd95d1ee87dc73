"""Scenes: built-in ones, those of the server's folder, and uploaded ones."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Annotated, Any
from urllib.parse import quote

from fastapi import APIRouter, Query, Request, Response
from fastapi import Path as InPath
from starlette.datastructures import UploadFile
from starlette.responses import FileResponse

from service.describe import scene_documents
from service.http.access import Admin, Read, Submit
from service.http.models import SceneList, SceneView
from service.http.problems import Problem, documented
from service.http.site import Site, SiteOf
from service.http.uploads import UploadedScene

router = APIRouter(prefix="/v1/scenes", tags=["scenes"])
Name = Annotated[str, InPath(max_length=200, examples=["cornell-box"])]
RAW = ("model/gltf-binary", "application/octet-stream")
FORM = "multipart/form-data"
CHUNK = 256 * 1024
BINARY: dict[str, Any] = {"type": "string", "format": "binary"}
BODY: dict[str, Any] = {
    "requestBody": {
        "required": True,
        "description": "One glTF 2.0 binary file (.glb), everything inside it.",
        "content": {
            RAW[0]: {"schema": BINARY},
            FORM: {"schema": {"type": "object", "required": ["file"], "properties": {"file": BINARY}}},
        },
    }
}


@router.get("", dependencies=[Read], responses=documented("unauthorized", "forbidden", "too-many-requests"))
def scenes(site: SiteOf) -> SceneList:
    """All scenes."""
    return SceneList(items=all_scenes(site))


@router.post(
    "",
    status_code=201,
    dependencies=[Submit],
    openapi_extra=BODY,
    responses={
        200: {"description": "These bytes were uploaded before", "model": SceneView},
        **documented(
            "bad-request", "unauthorized", "forbidden", "request-timeout", "payload-too-large", "unsupported-media-type",
            "refused-scene", "validation-failed", "too-many-requests", "unavailable",
        ),
    },
)  # fmt: skip
async def upload(
    site: SiteOf,
    request: Request,
    response: Response,
    description: Annotated[str, Query(max_length=200, description="A line on the scene, for people.")] = "",
) -> SceneView:
    """Upload a scene. It is read in a child process of limited memory and time; its name is a hash of its bytes."""
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind in RAW:
        scene, new = await site.uploads.receive(request.stream(), description)
    elif kind == FORM:
        async with request.form(max_files=1, max_fields=8) as form:
            file = form.get("file")
            if not isinstance(file, UploadFile):
                raise Problem("refused-scene", "the form has no file called `file`")
            scene, new = await site.uploads.receive(_chunks(file), description or (file.filename or "")[:200])
    else:
        raise Problem("unsupported-media-type", f"a scene comes as {RAW[0]} or {FORM} (got {kind[:100] or 'none'!r})")
    response.status_code = 201 if new else 200
    response.headers["location"] = f"/v1/scenes/{scene.name}"
    return _uploaded(scene)


@router.get(
    "/{name}",
    dependencies=[Read],
    responses=documented("unauthorized", "forbidden", "not-found", "validation-failed", "too-many-requests"),
)
def scene(site: SiteOf, name: Name) -> SceneView:
    """One scene."""
    return find_scene(site, name)


@router.get(
    "/{name}/thumbnail",
    dependencies=[Read],
    response_model=None,
    responses={
        200: {"content": {"image/png": {"schema": BINARY}}},
        **documented("unauthorized", "forbidden", "not-found", "validation-failed", "too-many-requests", "unavailable"),
    },
)
def thumbnail(site: SiteOf, name: Name) -> Response:
    """A preview without light transport, 384 × 216 pixels."""
    find_scene(site, name)
    return FileResponse(site.thumbnails.path(name), media_type="image/png", headers={"cache-control": "private, max-age=3600"})


@router.delete(
    "/{name}",
    status_code=204,
    dependencies=[Admin],
    responses=documented("unauthorized", "forbidden", "not-found", "validation-failed", "too-many-requests"),
)
def remove(site: SiteOf, name: Name) -> None:
    """Remove an uploaded scene. Evaluations made of it keep their results."""
    if not site.uploads.remove(name):
        raise Problem("not-found", f"no uploaded scene {name!r}")


def all_scenes(site: Site) -> list[SceneView]:
    """Every scene that an evaluation may name."""
    found = [SceneView(**document, thumbnail=_thumbnail(document["name"])) for document in scene_documents()]
    return found + [_uploaded(scene) for scene in site.uploads.all()]


def find_scene(site: Site, name: str) -> SceneView:
    """One of them. Raises Problem where there is none of that name."""
    found = next((scene for scene in all_scenes(site) if scene.name == name), None)
    if found is None:
        raise Problem("not-found", f"no scene {name!r}")
    return found


def _uploaded(scene: UploadedScene) -> SceneView:
    return SceneView(
        name=scene.name, kind="uploaded", description=scene.description, thumbnail=_thumbnail(scene.name), upload=scene
    )  # fmt: skip


def _thumbnail(name: str) -> str:
    return f"/v1/scenes/{quote(name, safe='')}/thumbnail"


async def _chunks(file: UploadFile) -> AsyncIterator[bytes]:
    while chunk := await file.read(CHUNK):
        yield chunk
