"""Errors as problems (RFC 9457, `application/problem+json`): type, title, status, detail.

`detail` says the rule, the value received and how to mend it. `type` is a URN of ours.
"""

from __future__ import annotations

import logging
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel, Field
from starlette.exceptions import HTTPException

from db.errors import Conflict, DatabaseAway, DatabaseError, NotFound, StoreAway, StoreFull
from db.objects import no_space
from scene.errors import SceneError

log = logging.getLogger(__name__)

MEDIA_TYPE = "application/problem+json"
RETRY_AFTER_S = 3
NO_SPACE_STATUS = 507
_LONGEST_VALUE = 80


class Problem(BaseModel):
    """What went wrong, for people and programs."""

    type: str = Field(description="What kind of problem.", examples=["urn:metanerf:not-found"])
    title: str = Field(description="The kind in words.", examples=["Not found"])
    status: int = Field(description="The HTTP status.", examples=[404])
    detail: str = Field(
        description="The rule, the value received, how to mend it.",
        examples=["id must be that of a person; got 'x'; list them to see what exists"],
    )


class ProblemError(HTTPException):
    """A problem on its way to the caller."""

    def __init__(
        self,
        status: int,
        kind: str,
        detail: str,
        *,
        title: str | None = None,
        headers: dict[str, str] | None = None,
    ) -> None:
        super().__init__(status, detail, headers or {})
        self.problem = Problem(
            type=f"urn:metanerf:{kind}",
            title=title or kind.replace("-", " ").capitalize(),
            status=status,
            detail=detail,
        )

    def __str__(self) -> str:
        return self.problem.detail


_KINDS: tuple[tuple[type[SceneError], int, str], ...] = (
    (NotFound, 404, "not-found"),
    (Conflict, 409, "conflict"),
    (StoreFull, NO_SPACE_STATUS, "no-space-left"),
    (StoreAway, 503, "store-away"),
    (DatabaseAway, 503, "database-away"),
    (SceneError, 422, "invalid-input"),
)


def problem_of(error: Exception) -> ProblemError:
    """The problem that `error` is; one that nobody foresaw tells no secrets."""
    if isinstance(error, ProblemError):
        return error
    if not isinstance(error, DatabaseError) and (full := no_space(error)):
        return ProblemError(NO_SPACE_STATUS, "no-space-left", full)
    for kind, status, name in _KINDS:
        if isinstance(error, kind):
            headers = {"Retry-After": str(RETRY_AFTER_S)} if status == 503 else None
            return ProblemError(status, name, str(error), headers=headers)
    return ProblemError(
        500, "internal-error", f"the server failed ({type(error).__name__}); its log says more"
    )


def problems(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """Responses that a route may give, for the API's description."""
    return {
        status: {
            "description": HTTPStatus(status).phrase,
            "content": {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}},
        }
        for status in statuses
    }


PROBLEMS = problems(401, 403, 404, 422, 503)
"""Those that nearly every route may give."""


def install(app: FastAPI) -> None:
    """Answer every error of `app` as a problem."""

    async def on_error(_request: Request, error: Exception) -> JSONResponse:
        return _response(problem_of(error))

    async def on_surprise(request: Request, error: Exception) -> JSONResponse:
        log.exception("%s %s failed", request.method, request.url.path, exc_info=error)
        return _response(problem_of(error))

    async def on_invalid(_request: Request, error: Exception) -> JSONResponse:
        assert isinstance(error, RequestValidationError)
        return _response(ProblemError(422, "invalid-input", _faults(error)))

    async def on_http(_request: Request, error: Exception) -> JSONResponse:
        assert isinstance(error, HTTPException)
        phrase = HTTPStatus(error.status_code).phrase
        kind = phrase.lower().replace(" ", "-")
        headers = dict(error.headers or {})
        return _response(ProblemError(error.status_code, kind, str(error.detail), headers=headers))

    app.add_exception_handler(ProblemError, on_error)
    app.add_exception_handler(SceneError, on_error)
    app.add_exception_handler(RequestValidationError, on_invalid)
    app.add_exception_handler(HTTPException, on_http)
    app.add_exception_handler(Exception, on_surprise)


def _response(error: ProblemError) -> JSONResponse:
    return JSONResponse(
        error.problem.model_dump(),
        status_code=error.problem.status,
        media_type=MEDIA_TYPE,
        headers=dict(error.headers or {}),
    )


def _faults(error: RequestValidationError) -> str:
    told = []
    for fault in error.errors()[:5]:
        if fault["type"] == "json_invalid":
            return f"the body must be JSON; got a fault at character {fault['loc'][-1]}: " + (
                f"{fault['ctx']['error']}; quote names and strings"
            )
        where = ".".join(str(part) for part in fault["loc"]) or "body"
        rule = str(fault["msg"]).removeprefix("Value error, ")
        value = repr(fault.get("input"))
        shown = value if len(value) <= _LONGEST_VALUE else f"{value[:_LONGEST_VALUE]}..."
        told.append(f"{where}: {rule}; got {shown}")
    return " | ".join(told)
