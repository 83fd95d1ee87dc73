"""`luxmeter token add | list | revoke`: who may use the service."""

from __future__ import annotations

from typing import Annotated

import typer

from service import parse
from service.options import Json
from service.output import console, print_json, print_table
from service.tokens import SCOPES, TokenStore

token = typer.Typer(name="token", help="Tokens of the HTTP service, in the data folder.", no_args_is_help=True)


@token.command("add")
def add(
    name: Annotated[str, typer.Argument(help="Whose it is.")],
    scope: Annotated[str, typer.Option(help=f"{', '.join(SCOPES)}; each includes those before it.")] = "submit",
    json: Json = False,
) -> None:
    """Make a token and print it; it can't be shown again."""
    parse.choice("--scope", scope, SCOPES)
    made, secret = TokenStore().add(name, next(s for s in SCOPES if s == scope))
    if json:
        print_json({"id": made.id, "name": made.name, "scope": made.scope, "created": made.created, "token": secret})
    else:
        console.print(f"token {made.id} for {made.name}, scope {made.scope}; keep it, it can't be shown again:", highlight=False)
        print(secret)


@token.command("list")
def show(json: Json = False) -> None:
    """List the tokens, without what only their owners know."""
    kept = [{"id": t.id, "name": t.name, "scope": t.scope, "created": t.created} for t in TokenStore().all()]
    if json:
        print_json(kept)
    else:
        print_table(("id", "name", "scope", "created"), [tuple(entry.values()) for entry in kept])


@token.command("revoke")
def revoke(id: Annotated[str, typer.Argument(metavar="ID")], json: Json = False) -> None:
    """Make a token useless at once, for running services too."""
    gone = TokenStore().revoke(id)
    if json:
        print_json({"id": gone.id, "revoked": True})
    else:
        print(f"revoked {gone.id} ({gone.name})")
