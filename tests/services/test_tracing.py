"""Traces: from a request through its job to the process that does it, and what never is in them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import httpx
import pytest

from scene.errors import InvalidInput
from services import composition
from services.app import create_app
from services.composition import build_services, open_tracing
from services.container import Services
from services.settings import Settings, load_settings
from services.tracing import PastSpan, Tracing
from tests.servers import free_port
from tests.services import seeds
from tests.services.collector import Collector, collecting
from tests.services.conftest import bearer, changed, serving
from tests.services.jobs.waiting import job_when, until

TRACE, CALLER = "0af7651916cd43dd8448eb211c80319c", "b7ad6b7169203331"
PARENT = f"00-{TRACE}-{CALLER}-01"


@pytest.fixture
def collector() -> Iterator[Collector]:
    with collecting() as made:
        yield made


@pytest.fixture
def traced(services: Services, collector: Collector) -> Iterator[Services]:
    settings = changed(services.settings, otlp_endpoint=collector.url)
    made = open_tracing(settings.tracing)
    yield replace(services, settings=settings, tracing=made)
    made.close()


async def _ask(traced: Services, method: str, path: str, **headers: str) -> httpx.Response:
    transport = httpx.ASGITransport(create_app(traced), raise_app_exceptions=False)
    async with httpx.AsyncClient(
        transport=transport, base_url="http://test", headers=bearer(traced) | headers
    ) as caller:
        return await caller.request(method, path)


def test_a_training_is_one_trace_from_the_request_to_its_process(
    settings: Settings, collector: Collector, sequence_folder: Path
):
    working = changed(settings, embedded_worker=True, otlp_endpoint=collector.url)
    services = build_services(working)
    services.database.migrate()
    sequence = seeds.captured(services, sequence_folder)
    services.close()
    with serving(working) as caller:
        path = f"/v1/sequences/{sequence.id}/models"
        asked = caller.post(path, json={"budget_s": 1.0}, headers={"traceparent": PARENT})
        job_id = asked.json()["id"]
        ended = job_when(caller, job_id, lambda job: job["state"] == "succeeded", "the training")
        until(lambda: collector.named("train job"), "its spans")
    (request,) = collector.named("POST /v1/sequences/{sequence_id}/models")
    assert (request.trace, request.parent) == (TRACE, CALLER)
    assert request.attributes["http.response.status_code"] == "202"
    (waits,), (job,) = collector.named("train job waits"), collector.named("train job")
    assert waits.is_in(request)
    assert job.is_in(request)
    assert waits.begin_ns < waits.end_ns <= job.begin_ns + 1_000_000_000
    assert job.process != request.process
    assert job.attributes["job.id"] == ended["id"]
    for name in ("fetch the frames", "train", "store the model"):
        (part,) = collector.named(name)
        assert part.is_in(job), name
        assert job.begin_ns <= part.begin_ns <= part.end_ns <= job.end_ns


async def test_a_request_that_fails_says_so_and_tells_no_ids(
    traced: Services, collector: Collector
):
    meeting_id = "0123456789abcdef" * 2
    answer = await _ask(traced, "GET", f"/v1/meetings/{meeting_id}?token=secret")
    assert answer.status_code == 404
    for path in ("/healthz", "/", "/docs"):
        await _ask(traced, "GET", path)
    traced.tracing.close()
    (span,) = collector.spans
    assert span.name == "GET /v1/meetings/{meeting_id}"
    assert span.attributes["http.response.status_code"] == "404"
    assert not [one for one in span.attributes.values() if meeting_id in one or "secret" in one]


@pytest.mark.parametrize("header", ["", "00-0-0-01", "nonsense", "ff-" + "0" * 60])
async def test_a_malformed_parent_begins_a_trace_of_its_own(
    traced: Services, collector: Collector, header: str
):
    answer = await _ask(traced, "GET", "/v1/people", traceparent=header)
    assert answer.status_code == 200
    traced.tracing.close()
    (span,) = collector.spans
    assert span.parent == ""


def test_what_fails_is_marked_by_its_kind_alone(traced: Services, collector: Collector):
    with pytest.raises(InvalidInput), traced.tracing.span("work"):
        raise InvalidInput("Ada's clip must be hers; got Bo's")
    traced.tracing.close()
    (span,) = collector.spans
    assert span.failed
    assert span.attributes == {"error.type": "InvalidInput"}


def test_spans_within_spans_and_spans_that_are_over(traced: Services, collector: Collector):
    with traced.tracing.span("outer"):
        within = traced.tracing.here()
        with traced.tracing.span("inner"):
            # of its own, whatever it is within
            traced.tracing.record(PastSpan("past", 10.0, 12.0), [PastSpan("half", 10.0, 11.0)])
    assert traced.tracing.here() is None
    traced.tracing.record(PastSpan("late", 20.0, 21.0), parent=within)
    traced.tracing.close()
    outer, inner, past, half, late = (
        collector.named(name)[0] for name in ("outer", "inner", "past", "half", "late")
    )
    assert inner.is_in(outer)
    assert late.is_in(outer)
    assert half.is_in(past)
    assert past.parent == ""
    assert (half.begin_ns, half.end_ns) == (10_000_000_000, 11_000_000_000)


async def test_a_collector_that_is_away_costs_traces_alone(services: Services):
    settings = changed(services.settings, otlp_endpoint=f"http://127.0.0.1:{free_port()}")
    away = replace(services, settings=settings, tracing=open_tracing(settings.tracing))
    assert (await _ask(away, "GET", "/v1/people")).status_code == 200
    away.tracing.close()


async def test_off_nothing_is_noted(services: Services, sequence_folder: Path):
    assert type(services.tracing) is Tracing
    with services.tracing.span("work") as tell:
        tell("name", "another")
        assert services.tracing.here() is None
    job_id = seeds.queued_training(services, seeds.captured(services, sequence_folder))
    with services.reading() as unit:
        assert unit.jobs.get(job_id).traceparent is None


def test_without_the_library_the_setting_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(composition, "find_spec", lambda _name: None)
    wanted = load_settings(otlp_endpoint="http://127.0.0.1:4318").tracing
    with pytest.raises(InvalidInput, match=r"pip install '\.\[tracing\]'"):
        open_tracing(wanted)


@pytest.mark.parametrize("address", ["127.0.0.1:4318", "grpc://one:4317", "http://"])
def test_an_address_that_is_none_is_refused(address: str):
    with pytest.raises(InvalidInput, match="METANERF_OTLP_ENDPOINT"):
        load_settings(otlp_endpoint=address)
