"""Plans as artefacts."""

from __future__ import annotations

from functools import cache, lru_cache

from pydantic import TypeAdapter

from jobs.artifacts import Artifacts
from jobs.plan import Plan


def store_plan(artifacts: Artifacts, plan: Plan) -> str:
    """Store a plan; returns its hash."""
    return artifacts.put(_plans().dump_json(plan))


@lru_cache(maxsize=8)
def load_plan(artifacts: Artifacts, name: str) -> Plan:
    """A plan from the store."""
    return _plans().validate_json(artifacts.get(name))


@cache
def _plans() -> TypeAdapter[Plan]:
    """Plans as JSON; making this takes longer than using it."""
    return TypeAdapter(Plan)
