"""The live interface against its own OpenAPI document: generated requests, single and in sequences."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import httpx
import pytest
import schemathesis
from http_service import HEALTHY, FakeQueue, serving
from hypothesis import HealthCheck, Phase, given, settings
from schemathesis.config import SchemathesisConfig
from schemathesis.generation import GenerationMode

from service.http.app import create_app
from service.http.settings import ServerSettings

# The same requests in every run: a change is tested by what it is, not by what was drawn that day.
CALM = {
    "deadline": None, "suppress_health_check": list(HealthCheck), "phases": [Phase.explicit, Phase.generate], "database": None,
    "derandomize": True,
}  # fmt: skip
# Other requests in every run, for the nightly suite: what fails is printed with the request that does it.
WILD = CALM | {"derandomize": False, "print_blob": True}
CONFIG = {
    "checks": {
        # What fits the schema may still name a scene or setting that does not exist, ask for another media type, come too early, or
        # ask for a machine that is not ready.
        "positive_data_acceptance": {"expected-statuses": [200, 201, 202, 204, 206, 304, 404, 406, 409, 415, 422, 503]},
        # Unknown query parameters are ignored, as everywhere on the web.
        "negative_data_rejection": {
            "expected-statuses": [200, 201, 202, 204, 400, 401, 403, 404, 405, 406, 409, 413, 415, 422, 503]
        },
    },
    "generation": {"mode": "all"},
}
# Operations with parameters or bodies that a schema can refuse; a path takes any text.
CAN_BE_WRONG = ("POST /v1/evaluations", "GET /v1/evaluations", "GET /v1/comparisons")


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    settings = ServerSettings(home=tmp_path_factory.mktemp("home"), requests_per_s=0, submissions_per_s=0, poll_s=0.01)
    queue = FakeQueue(finish_at_once=True)
    with serving(create_app(queue, settings, machine=lambda: HEALTHY)) as found:
        yield found


@pytest.fixture(scope="module")
def api(address: str) -> Any:
    return schemathesis.openapi.from_url(f"{address}/openapi.json", config=SchemathesisConfig.from_dict(CONFIG))


@pytest.mark.parametrize("mode", [GenerationMode.POSITIVE, GenerationMode.NEGATIVE])
def test_every_operation_keeps_to_the_schema(api: Any, mode: GenerationMode) -> None:
    operations = [found.ok() for found in api.get_all_operations()]
    assert len(operations) >= 17
    for operation in operations:
        if mode is GenerationMode.NEGATIVE and operation.label not in CAN_BE_WRONG:
            continue

        @settings(max_examples=6, **CALM)
        @given(case=operation.as_strategy(generation_mode=mode))
        def ask(case: schemathesis.Case) -> None:
            case.call_and_validate(timeout=20)

        ask()


def test_sequences_of_operations_keep_to_the_schema(api: Any) -> None:
    api.as_state_machine().run(settings=settings(max_examples=4, stateful_step_count=5, **CALM))


def test_events_keep_to_the_schema(api: Any, address: str) -> None:
    made = httpx.post(f"{address}/v1/evaluations", json={"scenes": ["cornell-box"], "methods": [{"name": "ir"}]}).json()
    case = api["/v1/evaluations/{id}/events"]["GET"].Case(
        path_parameters={"id": made["id"]}, headers={"accept": "text/event-stream"}
    )
    assert "event: end" in case.call_and_validate(timeout=20).text


@pytest.mark.slow
@pytest.mark.parametrize("mode", [GenerationMode.POSITIVE, GenerationMode.NEGATIVE])
def test_requests_drawn_anew_each_night_keep_to_the_schema(api: Any, mode: GenerationMode) -> None:
    for operation in (found.ok() for found in api.get_all_operations()):
        if mode is GenerationMode.NEGATIVE and operation.label not in CAN_BE_WRONG:
            continue

        @settings(max_examples=60, **WILD)
        @given(case=operation.as_strategy(generation_mode=mode))
        def ask(case: schemathesis.Case) -> None:
            case.call_and_validate(timeout=20)

        ask()


@pytest.mark.slow
def test_sequences_drawn_anew_each_night_keep_to_the_schema(api: Any) -> None:
    api.as_state_machine().run(settings=settings(max_examples=40, stateful_step_count=8, **WILD))
