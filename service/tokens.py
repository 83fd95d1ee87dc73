"""Bearer tokens: made once, shown once, kept only as hashes.

A token is `lux_` and 256 random bits: nobody can guess it from a plain SHA-256, and a slow hash would only slow the service.
The file is read anew whenever it changes: a revoked token stops working at once, without a restart.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import secrets
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

from jobs.errors import RequestError
from jobs.files import whole
from jobs.store import Store

Scope = Literal["read", "submit", "admin"]
SCOPES: tuple[Scope, ...] = ("read", "submit", "admin")
PREFIX = "lux_"


@dataclass(frozen=True)
class Token:
    """What is kept of a token. A scope includes those before it: admin may submit, submit may read."""

    id: str
    name: str
    scope: Scope
    digest: str
    created: str

    def allows(self, scope: Scope) -> bool:
        """Whether this token may do what `scope` is asked for."""
        return SCOPES.index(self.scope) >= SCOPES.index(scope)


class TokenStore:
    """Tokens in one JSON file, by default `tokens.json` in the data folder, readable by its owner only."""

    def __init__(self, path: Path | None = None) -> None:
        self.path = path or Store().home / "tokens.json"
        self._read_at: tuple[int, int] | None = None
        self._tokens: tuple[Token, ...] = ()

    def all(self) -> tuple[Token, ...]:
        """Every token, oldest first."""
        try:
            found = self.path.stat()
        except FileNotFoundError:
            self._read_at, self._tokens = None, ()
            return ()
        stamp = (found.st_mtime_ns, found.st_ino)
        if stamp != self._read_at:
            self._tokens = tuple(Token(**entry) for entry in json.loads(self.path.read_text()))
            self._read_at = stamp
        return self._tokens

    def add(self, name: str, scope: Scope) -> tuple[Token, str]:
        """Make a token; returns what is kept and the token itself, which nothing can show again."""
        secret = PREFIX + secrets.token_urlsafe(32)
        token = Token(secrets.token_hex(4), name, scope, digest(secret), datetime.now(UTC).isoformat(timespec="seconds"))
        self._write((*self.all(), token))
        return token, secret

    def revoke(self, id: str) -> Token:
        """Forget a token. Raises RequestError where there is none of that id."""
        kept = {token.id: token for token in self.all()}
        if id not in kept:
            raise RequestError(f"no token {id!r}; known: {', '.join(kept) or 'none'}")
        gone = kept.pop(id)
        self._write(tuple(kept.values()))
        return gone

    def find(self, secret: str) -> Token | None:
        """The token a client sent, None where it is unknown. Compares in constant time."""
        sent = digest(secret)
        return next((token for token in self.all() if hmac.compare_digest(token.digest, sent)), None)

    def _write(self, tokens: tuple[Token, ...]) -> None:
        with whole(self.path) as path:
            path.touch(mode=0o600)
            path.write_text(json.dumps([asdict(token) for token in tokens], indent=2) + "\n")


def digest(secret: str) -> str:
    """SHA-256 of a token."""
    return hashlib.sha256(secret.encode("utf-8", "surrogateescape")).hexdigest()
