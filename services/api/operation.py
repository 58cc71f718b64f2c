"""For the people who run it: is it up, is it ready, what does it do."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import redis
from fastapi import APIRouter, Response
from fastapi.responses import JSONResponse
from prometheus_client import CONTENT_TYPE_LATEST
from pydantic import BaseModel

from db.errors import DatabaseError
from services.api.dependencies import Provided
from services.container import Services
from services.metrics import exposition
from services.problems import RETRY_AFTER_S

router = APIRouter(tags=["operation"])


class Health(BaseModel):
    """The process lives."""

    status: Literal["ok"] = "ok"


class Readiness(BaseModel):
    """What the process needs, and whether it is there."""

    status: Literal["ready", "unready"]
    checks: dict[str, str]


@router.get("/healthz", summary="Check liveness")
def healthz() -> Health:
    """Answers as long as the process runs."""
    return Health()


@router.get("/readyz", summary="Check readiness", responses={503: {"model": Readiness}})
def readyz(services: Provided) -> JSONResponse:
    """Whether database, object store and Redis answer; names those that do not."""
    checks = readiness(services)
    ready = all(state == "ok" for state in checks.values())
    answer = Readiness(status="ready" if ready else "unready", checks=checks)
    headers = None if ready else {"Retry-After": str(RETRY_AFTER_S)}
    return JSONResponse(answer.model_dump(), status_code=200 if ready else 503, headers=headers)


@router.get(
    "/metrics",
    summary="Figures for Prometheus",
    response_class=Response,
    responses={200: {"content": {"text/plain": {}}}},
)
def metrics(services: Provided) -> Response:
    """Requests, jobs and live sessions in Prometheus' text format."""
    return Response(exposition(services), headers={"Content-Type": CONTENT_TYPE_LATEST})


def readiness(services: Services) -> dict[str, str]:
    """`ok`, or why not, of everything this process needs."""
    checks: dict[str, Callable[[], None]] = {
        "database": services.database.ping,
        "objects": services.objects.ping,
    }
    if services.settings.events.redis_url:
        checks["redis"] = services.events.ping
    found = {}
    for name, ping in checks.items():
        try:
            ping()
            found[name] = "ok"
        except (DatabaseError, redis.RedisError) as error:
            found[name] = str(error)
    return found
