"""Who may do what. A token comes as `Authorization: Bearer`, or, from a browser that logged in, as a cookie."""

from __future__ import annotations

from collections.abc import Callable

from fastapi import Depends, Request

from service.http.problems import Problem
from service.http.site import SiteOf
from service.tokens import Scope

COOKIE = "luxmeter_token"


def requires(scope: Scope) -> Callable[[Request, SiteOf], None]:
    """A dependency that lets a request pass whose token allows `scope`; any request while no token is configured."""

    def check(request: Request, site: SiteOf) -> None:
        if not site.settings.require_token and not site.tokens.all():
            return
        sent = bearer(request)
        if sent is None:
            raise Problem("unauthorized", "this service wants a token", {"www-authenticate": 'Bearer realm="luxmeter"'})
        token = site.tokens.find(sent)
        if token is None:
            headers = {"www-authenticate": 'Bearer realm="luxmeter", error="invalid_token"'}
            raise Problem("unauthorized", "the token is unknown or was revoked", headers)
        if not token.allows(scope):
            headers = {"www-authenticate": f'Bearer realm="luxmeter", error="insufficient_scope", scope="{scope}"'}
            raise Problem("forbidden", f"this needs a token with scope {scope}; yours has {token.scope}", headers)

    return check


def bearer(request: Request) -> str | None:
    """The token of the request, None where there is none."""
    scheme, _, token = request.headers.get("authorization", "").partition(" ")
    if scheme.lower() == "bearer" and token.strip():
        return token.strip()
    return request.cookies.get(COOKIE) or None


Read = Depends(requires("read"))
Submit = Depends(requires("submit"))
Admin = Depends(requires("admin"))
