"""For the people who run it: is it up, is it ready, what does it do."""

from __future__ import annotations

from typing import Literal

from fastapi import APIRouter, Response
from fastapi.responses import JSONResponse
from prometheus_client import CONTENT_TYPE_LATEST
from pydantic import BaseModel, Field

from services.api.dependencies import CurrentGateway, Provided
from services.api.scraping import FiguresReader
from services.metrics import exposition
from services.problems import RETRY_AFTER_S, problems
from services.readiness import Status, check_stores, status_of

router = APIRouter(tags=["operation"])


class Health(BaseModel):
    """The process lives."""

    status: Literal["ok"] = "ok"


class Readiness(BaseModel):
    """What the process needs, and whether it is there."""

    status: Status = Field(description="Degraded: it serves, without what it can do without.")
    checks: dict[str, str]


@router.get("/healthz", summary="Check liveness")
async def healthz() -> Health:
    """Answers as long as the process runs, whatever else is away."""
    return Health()


@router.get("/readyz", summary="Check readiness", responses={503: {"model": Readiness}})
def readyz(gateway: CurrentGateway) -> JSONResponse:
    """Whether database, object store and Redis answer; names those that do not.

    Without database or object store it is `unready` (503), and so is a gateway that drains; without
    Redis it is only `degraded` (200).
    """
    checks = check_stores(gateway.services)
    if gateway.homes.draining:
        checks["gateway"] = "drains: it was told to end, and its meetings go on elsewhere"
    answer = Readiness(status=status_of(checks), checks=checks)
    unready = answer.status == "unready"
    headers = {"Retry-After": str(RETRY_AFTER_S)} if unready else None
    return JSONResponse(answer.model_dump(), status_code=503 if unready else 200, headers=headers)


@router.get(
    "/metrics",
    summary="Figures for Prometheus",
    response_class=Response,
    responses={200: {"content": {"text/plain": {}}}, **problems(401, 403)},
    dependencies=[FiguresReader],
)
def metrics(services: Provided) -> Response:
    """Requests, jobs and live sessions in Prometheus' text format.

    Only for callers from a private network that came without a proxy, or, where the server has set
    one, with its token.
    """
    return Response(exposition(services), headers={"Content-Type": CONTENT_TYPE_LATEST})
