"""Whatever is sent by whoever may, no route fails: by the API's own description, with real ids."""

from __future__ import annotations

import asyncio
import os
from typing import Any

import httpx
import pytest
import requests
import schemathesis
from fastapi import FastAPI
from fastapi.routing import APIRoute
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from schemathesis import Case, GenerationMode
from schemathesis.checks import not_a_server_error
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    response_schema_conformance,
)
from schemathesis.specs.openapi.schemas import OpenApiSchema

from services.app import ROUTERS, create_app
from services.container import Services
from services.gateway import gateway_of
from tests.services.api.authorisation_world import Belongings, Caller, World
from tests.services.conftest import stored_files

EXAMPLES = int(os.environ.get("METANERF_FUZZ_EXAMPLES", "8"))
"""Of each route and kind of data; few in CI, where the same are tried each time."""
OPERATIONS = sorted(
    (route.path, method)
    for router in ROUTERS
    for route in router.routes
    if isinstance(route, APIRoute) and route.include_in_schema
    for method in route.methods or ()
)
_CALLERS = (Caller.GUEST, Caller.HOST, Caller.SPEAKER)
"""Whom most routes let in, so that what they are sent is read."""
_NAMES = {"model_ids": "model_id", "motion_sequence_id": "sequence_id", "improves": "model_id"}
"""Fields of bodies that name what is there."""
_CHECKS = [not_a_server_error, content_type_conformance, response_schema_conformance]


def _with_real_ids(case: Case, owner: Belongings) -> None:
    """Have a generated request name what there is: else all it would ever hear is 404."""
    for name in case.path_parameters or {}:
        case.path_parameters[name] = owner.params.get(name, case.path_parameters[name])
    if isinstance(case.body, dict):
        for name, value in case.body.items():
            if (known := owner.params.get(_NAMES.get(str(name), str(name)))) and value:
                case.body[name] = [known] if isinstance(value, list) else known


def _request(case: Case, headers: dict[str, str]) -> httpx.Request:
    """What travels for a case."""
    made: dict[str, Any] = case.as_transport_kwargs(base_url="http://test")
    made["headers"] = {**made.get("headers", {}), **headers}
    made.pop("cookies", None)
    sent = requests.Request(**made).prepare()
    body = sent.body.encode() if isinstance(sent.body, str) else sent.body
    assert body is None or isinstance(body, bytes)
    assert sent.method is not None
    assert sent.url is not None
    fields = {
        name: value if isinstance(value, str) else value.decode()
        for name, value in sent.headers.items()
        if name != "Content-Length"
    }
    return httpx.Request(sent.method, sent.url, headers=fields, content=body)


@pytest.fixture(scope="module")
def described() -> OpenApiSchema:
    """The API as it describes itself."""
    app = FastAPI(separate_input_output_schemas=False)
    for router in ROUTERS:
        app.include_router(router)
    return schemathesis.openapi.from_dict(app.openapi())


@pytest.mark.parametrize(("path", "method"), OPERATIONS)
def test_no_route_fails_whatever_it_is_sent(
    world_services: Services, world: World, described: OpenApiSchema, path: str, method: str
):
    app = create_app(world_services)
    operation = described[path][method]
    modes = [GenerationMode.POSITIVE]
    if operation.body or operation.query:
        modes.append(GenerationMode.NEGATIVE)
    cases = st.one_of([operation.as_strategy(generation_mode=mode) for mode in modes])
    transport = httpx.ASGITransport(app, raise_app_exceptions=False)

    async def answer(request: httpx.Request) -> httpx.Response:
        async with httpx.AsyncClient(transport=transport) as client:
            return await client.send(request)

    with asyncio.Runner() as runner:

        @settings(
            max_examples=EXAMPLES * len(modes),
            derandomize=True,
            database=None,
            phases=[Phase.generate],
            suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
        )
        @given(case=cases, caller=st.sampled_from(_CALLERS), real=st.integers(0, 4))
        def attack(case: Case, caller: Caller, real: int) -> None:
            if real:
                _with_real_ids(case, world.ada)
            response = runner.run(answer(_request(case, world.headers(caller))))
            case.validate_response(response, checks=_CHECKS)

        attack()
        runner.run(gateway_of(app).close())
    assert not [one for one in stored_files(world_services.settings) if "scratch" in one.parts]
    assert list(world_services.objects.incoming()) == []
    for owner in world_services.objects.owners():
        with world_services.reading() as unit:
            known = unit.references.of_owner(owner)
        assert {info.sha256 for info in world_services.objects.list(owner)} <= known
