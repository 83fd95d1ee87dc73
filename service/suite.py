"""Nightly suites: TOML files of evaluations, each a part with scenes, methods and settings of its own."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from jobs import EvaluationRequest, Plan, plan
from jobs.errors import RequestError, one_line

DEFAULT = Path(__file__).parents[1] / "suites" / "nightly.toml"
NAME = re.compile(r"[a-z0-9][a-z0-9-]*")


class Suite(BaseModel):
    """A suite. `defaults` holds fields of an evaluation request that parts need not repeat; `part` maps names to requests."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    name: str
    defaults: dict[str, Any] = {}
    part: dict[str, dict[str, Any]] = Field(min_length=1, max_length=64)

    @field_validator("name")
    @classmethod
    def _plain(cls, name: str) -> str:
        if not NAME.fullmatch(name):
            raise ValueError("takes small letters, digits and dashes")
        return name

    def requests(self) -> dict[str, EvaluationRequest]:
        """The evaluation request of each part, by name. Raises RequestError naming the part."""
        found = {}
        for part, fields in self.part.items():
            if not NAME.fullmatch(part):
                raise RequestError(f"part {part!r}: names take small letters, digits and dashes")
            try:
                found[part] = EvaluationRequest.model_validate(self.defaults | fields)
            except ValidationError as error:
                raise RequestError(f"part {part}: {one_line(error)}") from None
        return found

    def plans(self) -> dict[str, Plan]:
        """The plan of each part: every scene, method and setting is checked. Raises RequestError naming the part."""
        found = {}
        for part, request in self.requests().items():
            try:
                found[part] = plan(request)
            except RequestError as error:
                raise RequestError(f"part {part}: {error}") from None
        return found


def load(path: Path) -> Suite:
    """Read a suite. Raises RequestError in one line."""
    try:
        return Suite.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
    except OSError as error:
        raise RequestError(f"can't read the suite {path}: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise RequestError(f"{path} is not TOML: {error}") from None
    except ValidationError as error:
        raise RequestError(f"{path}: {one_line(error)}") from None
