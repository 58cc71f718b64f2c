"""Errors as problems (RFC 9457, `application/problem+json`): type, title, status, detail.

The one place that knows which error is answered by which status and problem type. `detail` says the
rule, the value received and how to mend it. `type` is a URN of ours.
"""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable
from http import HTTPStatus
from typing import Any, NamedTuple

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException

from db.errors import Conflict, DatabaseAway, DatabaseError, NotFound, StoreAway, StoreFull
from db.objects import no_space
from renderer.errors import ForgotTooMuch
from scene.errors import SceneError
from services import errors
from services.problem_details import Problem

log = logging.getLogger(__name__)

MEDIA_TYPE = "application/problem+json"
RETRY_AFTER_S = 3
"""Until the store or the database may be back."""
_LONGEST_VALUE = 80


class ProblemKind(NamedTuple):
    """How a class of errors is answered."""

    status: int
    name: str
    """Last part of the problem's URN, and its title with spaces."""

    def problem(self, detail: str) -> Problem:
        """The problem of this kind."""
        title = self.name.replace("-", " ").capitalize()
        return Problem(
            type=f"urn:metanerf:{self.name}", title=title, status=self.status, detail=detail
        )


NAMES: dict[int, dict[type[SceneError], str]] = {
    307: {errors.LivesElsewhere: "lives-elsewhere"},
    400: {
        errors.BadCandidate: "bad-candidate",
        errors.LoginStale: "login-stale",
        errors.ProtocolViolation: "bad-request",
    },
    401: {errors.Unauthorized: "unauthorized"},
    403: {
        errors.Forbidden: "forbidden",
        errors.ScopeMissing: "scope-missing",
        errors.QuotaReached: "quota-reached",
        errors.NotOwner: "not-yours",
        errors.OtherMeeting: "other-meeting",
        errors.AccessNotOpen: "access-not-open",
        errors.LoginNotOffered: "login-not-offered",
        errors.LoginDenied: "login-denied",
        errors.NoSeat: "no-seat",
        errors.SeatReleased: "seat-given-back",
        errors.AwaitingAdmission: "not-let-in-yet",
        errors.AdmissionDenied: "not-let-in",
        errors.RemovedFromMeeting: "removed",
        errors.AdmissionEnded: "meeting-over",
        errors.InvitationRenewed: "invitation-renewed",
        errors.ViewerMayNotSpeak: "viewers-look-on",
        errors.HostCommand: "host-only",
        errors.NotTakingPart: "not-taking-part",
        errors.NotHost: "not-host",
        errors.NotPresenting: "not-presenting",
        errors.NotInMeeting: "not-in-meeting",
        errors.NoConsent: "no-consent",
        errors.NotInRecording: "not-in-recording",
    },
    404: {NotFound: "not-found"},
    409: {
        Conflict: "conflict",
        errors.WrongState: "conflict",
        errors.JobOver: "job-over",
        errors.NotResumable: "not-resumable",
        errors.SequenceInUse: "sequence-in-use",
        errors.NotCaptured: "not-captured",
        errors.MeetingFull: "meeting-full",
        errors.MeetingSealed: "meeting-sealed",
        errors.TargetIsHost: "host-stays",
        errors.NothingRecorded: "nothing-recorded",
        errors.StillRecording: "still-recording",
        errors.NoOwnPerson: "nobody-of-yours",
        errors.DrivenElsewhere: "driven-elsewhere",
        errors.NotKeepable: "not-keepable",
        errors.NothingKept: "nothing-kept",
        errors.WrongOffset: "wrong-offset",
        errors.HelloRepeated: "greeted-already",
    },
    410: {errors.Gone: "gone", errors.MeetingOver: "meeting-over", errors.ClipGone: "clip-gone"},
    412: {errors.PreconditionFailed: "precondition-failed"},
    413: {errors.TooLarge: "too-large"},
    415: {errors.UnsupportedMediaType: "unsupported-media-type"},
    422: {
        SceneError: "invalid-input",
        errors.Unusable: "invalid-input",
        errors.WrongHash: "wrong-hash",
        errors.KeypointsOnly: "keypoints-only",
        ForgotTooMuch: "forgot-too-much",
        errors.OfferRefused: "invalid-input",
        errors.InvalidForm: "invalid-form",
        errors.HelloExpected: "hello-first",
        errors.NoIceRestart: "no-ice-restart",
    },
    428: {errors.PreconditionRequired: "precondition-required"},
    429: {errors.TooManyRequests: "too-many-requests"},
    500: {errors.WorkerDied: "worker-died"},
    502: {errors.ProviderFault: "provider-fault"},
    503: {
        StoreAway: "store-away",
        DatabaseAway: "database-away",
        errors.Unavailable: "unavailable",
        errors.NoSeatFree: "no-seat",
        errors.ServerFull: "server-full",
        errors.Draining: "draining",
        errors.RenderersAway: "renderers-away",
        errors.ProviderAway: "provider-away",
        errors.LandmarkModelMissing: "landmark-model-missing",
    },
    507: {StoreFull: "no-space-left"},
}
KINDS: dict[type[Exception], ProblemKind] = {
    error: ProblemKind(status, name)
    for status, names in NAMES.items()
    for error, name in names.items()
}
"""By class of error; a class that is not listed is answered as the nearest base that is."""
_INTERNAL = ProblemKind(500, "internal-error")


def problem_of(error: Exception) -> Problem:
    """The problem that `error` is; one that nobody foresaw tells no secrets."""
    if not isinstance(error, (DatabaseError, errors.ServiceError)) and (full := no_space(error)):
        return KINDS[StoreFull].problem(full)
    kind = next((KINDS[base] for base in type(error).__mro__ if base in KINDS), None)
    if kind is None:
        return _INTERNAL.problem(f"the server failed ({type(error).__name__}); its log says more")
    return kind.problem(str(error))


def stored_failure(error: Exception) -> dict[str, Any]:
    """The problem that `error` is, as the row of a job that failed keeps it."""
    return problem_of(error).model_dump()


def headers_of(error: Exception) -> dict[str, str]:
    """What the answer to `error` says in its header."""
    match error:
        case StoreAway() | DatabaseAway():
            return {"Retry-After": str(RETRY_AFTER_S)}
        case errors.Unavailable() | errors.TooManyRequests():
            return {"Retry-After": str(error.retry_after_s)}
        case errors.LivesElsewhere():
            return {"Location": error.address}
        case errors.Unauthorized():
            return {"WWW-Authenticate": "Bearer"}
        case errors.ScopeMissing():
            challenge = f'Bearer error="insufficient_scope", scope="{error.scope}"'
            return {"WWW-Authenticate": challenge}
        case errors.WrongOffset():
            return {"Upload-Offset": str(error.offset), "Upload-Length": str(error.length)}
    return {}


def problem_response(error: Exception) -> JSONResponse:
    """The answer to `error`."""
    return _response(problem_of(error), headers_of(error))


def problems(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """Responses that a route may give, for the API's description."""
    return {
        status: {
            "description": HTTPStatus(status).phrase,
            "content": {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}},
        }
        for status in statuses
    }


PROBLEMS = problems(401, 403, 404, 422, 429, 503)
"""Those that nearly every route may give."""


def install(app: FastAPI, on_refusal: Callable[[Request, Exception], Awaitable[None]]) -> None:
    """Answer every error of `app` as a problem; `on_refusal` is told of callers who may not."""

    async def on_error(request: Request, error: Exception) -> JSONResponse:
        if isinstance(error, errors.Forbidden | errors.Unauthorized):
            await on_refusal(request, error)
        return problem_response(error)

    async def on_surprise(request: Request, error: Exception) -> JSONResponse:
        # the pattern alone: a meeting's id is its invitation
        route = getattr(request.scope.get("route"), "path", "an address of no route")
        log.exception("%s %s failed", request.method, route, exc_info=error)
        return problem_response(error)

    async def on_invalid(_request: Request, error: Exception) -> JSONResponse:
        assert isinstance(error, RequestValidationError)
        return _response(KINDS[SceneError].problem(_faults(error)), {})

    async def on_http(request: Request, error: Exception) -> JSONResponse:
        assert isinstance(error, HTTPException)
        if isinstance(error.__cause__, SceneError):
            # FastAPI answers 400 to whatever ends the reading of a body: the cause says more
            return await on_error(request, error.__cause__)
        phrase = HTTPStatus(error.status_code).phrase
        kind = ProblemKind(error.status_code, phrase.lower().replace(" ", "-"))
        return _response(kind.problem(str(error.detail)), dict(error.headers or {}))

    app.add_exception_handler(SceneError, on_error)
    app.add_exception_handler(RequestValidationError, on_invalid)
    app.add_exception_handler(HTTPException, on_http)
    app.add_exception_handler(Exception, on_surprise)


def _response(problem: Problem, headers: dict[str, str]) -> JSONResponse:
    return JSONResponse(
        problem.model_dump(), status_code=problem.status, media_type=MEDIA_TYPE, headers=headers
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
