"""The registry of published claims: modules of `jobs.claims` register what they reproduce."""

from __future__ import annotations

import importlib
import pkgutil

from jobs.claims.model import PublishedClaim
from jobs.errors import RequestError
from renderers import registered_methods

_CLAIMS: dict[str, PublishedClaim] = {}


class UnknownClaim(RequestError):
    """No claim of that id; the message lists those there are."""


def register(claim: PublishedClaim) -> PublishedClaim:
    """Make a claim known by its id. Raises ValueError where another one has it."""
    if _CLAIMS.setdefault(claim.id, claim) is not claim:
        raise ValueError(f"claim {claim.id!r} is registered already")
    return claim


def registered_claims() -> dict[str, PublishedClaim]:
    """All registered claims by id, sorted: those of all modules of `jobs.claims` and of those that LUXMETER_PLUGINS lists."""
    import jobs.claims as package

    registered_methods()  # imports the plugins

    for module in pkgutil.iter_modules(package.__path__):
        importlib.import_module(f"jobs.claims.{module.name}")
    return dict(sorted(_CLAIMS.items()))


def get_claim(id: str) -> PublishedClaim:
    """The claim registered under `id`. Raises UnknownClaim listing the known ones."""
    known = registered_claims()
    if id not in known:
        raise UnknownClaim(f"unknown claim {id!r}; known: {', '.join(known)}")
    return known[id]
