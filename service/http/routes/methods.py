"""Methods: what they are, what they take, what they claim."""

from __future__ import annotations

from fastapi import APIRouter

from renderers import UnknownMethod, get_method, registered_methods
from service.describe import method_document
from service.http.access import Read
from service.http.models import MethodList, MethodView
from service.http.problems import Problem, documented

router = APIRouter(prefix="/v1/methods", tags=["methods"])


@router.get("", dependencies=[Read], responses=documented("unauthorized", "forbidden", "too-many-requests"))
def methods() -> MethodList:
    """All methods."""
    return MethodList(items=[MethodView.model_validate(method_document(method)) for method in registered_methods().values()])


@router.get(
    "/{name}",
    dependencies=[Read],
    responses=documented("unauthorized", "forbidden", "not-found", "validation-failed", "too-many-requests"),
)
def method(name: str) -> MethodView:
    """One method."""
    try:
        return MethodView.model_validate(method_document(get_method(name)))
    except UnknownMethod as error:
        raise Problem("not-found", str(error)) from None
