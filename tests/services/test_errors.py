"""Every error has one answer, which the wire knows by status, problem type and header."""

from __future__ import annotations

import errno
import inspect
from collections import Counter

import httpx
import pytest
from fastapi import FastAPI, Request

from db.errors import Conflict, DatabaseAway, MigrationFailed, NotFound, StoreAway, StoreFull
from scene.errors import InvalidInput, SceneError
from services import errors, problems
from services.api.body_limit import LARGEST_BODY_BYTES, LimitBodies
from services.errors import ServiceError
from services.problems import KINDS, headers_of, problem_of, stored_failure

WIRE: dict[type[SceneError], tuple[int, str]] = {
    SceneError: (422, "invalid-input"),
    InvalidInput: (422, "invalid-input"),
    NotFound: (404, "not-found"),
    Conflict: (409, "conflict"),
    StoreFull: (507, "no-space-left"),
    StoreAway: (503, "store-away"),
    DatabaseAway: (503, "database-away"),
    MigrationFailed: (422, "invalid-input"),
    errors.AccessNotOpen: (403, "access-not-open"),
    errors.AdmissionDenied: (403, "not-let-in"),
    errors.AdmissionEnded: (403, "meeting-over"),
    errors.AwaitingAdmission: (403, "not-let-in-yet"),
    errors.BadCandidate: (400, "bad-candidate"),
    errors.ClipGone: (410, "clip-gone"),
    errors.Draining: (503, "draining"),
    errors.DrivenElsewhere: (409, "driven-elsewhere"),
    errors.HelloExpected: (422, "hello-first"),
    errors.HelloRepeated: (409, "greeted-already"),
    errors.HostCommand: (403, "host-only"),
    errors.InvalidForm: (422, "invalid-form"),
    errors.InvitationRenewed: (403, "invitation-renewed"),
    errors.JobOver: (409, "job-over"),
    errors.KeypointsOnly: (422, "keypoints-only"),
    errors.LandmarkModelMissing: (503, "landmark-model-missing"),
    errors.LoginDenied: (403, "login-denied"),
    errors.LoginNotOffered: (403, "login-not-offered"),
    errors.LoginStale: (400, "login-stale"),
    errors.ProviderAway: (503, "provider-away"),
    errors.ProviderFault: (502, "provider-fault"),
    errors.LivesElsewhere: (307, "lives-elsewhere"),
    errors.MeetingFull: (409, "meeting-full"),
    errors.MeetingOver: (410, "meeting-over"),
    errors.MeetingSealed: (409, "meeting-sealed"),
    errors.NoIceRestart: (422, "no-ice-restart"),
    errors.NoOwnPerson: (409, "nobody-of-yours"),
    errors.NoSeat: (403, "no-seat"),
    errors.NoSeatFree: (503, "no-seat"),
    errors.NotCaptured: (409, "not-captured"),
    errors.NotHost: (403, "not-host"),
    errors.NotKeepable: (409, "not-keepable"),
    errors.NothingKept: (409, "nothing-kept"),
    errors.NotInMeeting: (403, "not-in-meeting"),
    errors.NotInRecording: (403, "not-in-recording"),
    errors.QuotaReached: (403, "quota-reached"),
    errors.NotOwner: (403, "not-yours"),
    errors.NoConsent: (403, "no-consent"),
    errors.NotTakingPart: (403, "not-taking-part"),
    errors.NotPresenting: (403, "not-presenting"),
    errors.NotResumable: (409, "not-resumable"),
    errors.NothingRecorded: (409, "nothing-recorded"),
    errors.OfferRefused: (422, "invalid-input"),
    errors.OtherMeeting: (403, "other-meeting"),
    errors.PreconditionFailed: (412, "precondition-failed"),
    errors.PreconditionRequired: (428, "precondition-required"),
    errors.RemovedFromMeeting: (403, "removed"),
    errors.RenderersAway: (503, "renderers-away"),
    errors.ScopeMissing: (403, "scope-missing"),
    errors.SeatReleased: (403, "seat-given-back"),
    errors.SequenceInUse: (409, "sequence-in-use"),
    errors.ServerFull: (503, "server-full"),
    errors.StillRecording: (409, "still-recording"),
    errors.TargetIsHost: (409, "host-stays"),
    errors.TooLarge: (413, "too-large"),
    errors.TooManyRequests: (429, "too-many-requests"),
    errors.Unauthorized: (401, "unauthorized"),
    errors.UnsupportedMediaType: (415, "unsupported-media-type"),
    errors.ViewerMayNotSpeak: (403, "viewers-look-on"),
    errors.WorkerDied: (500, "worker-died"),
    errors.WrongHash: (422, "wrong-hash"),
    errors.WrongOffset: (409, "wrong-offset"),
}
"""What clients have been told since the first release; a status or type never changes."""
_DATA = {
    errors.LivesElsewhere: ("https://one.example/whep/m",),
    errors.ScopeMissing: ("write",),
    errors.TooManyRequests: (7,),
    errors.Unavailable: (15,),
    errors.WrongOffset: (3, 9),
}


def raised(kind: type[SceneError], message: str = "the rule; got x; mend it") -> SceneError:
    """An error of this class, with the data that it carries."""
    data = next((values for base, values in _DATA.items() if issubclass(kind, base)), ())
    return kind(message, *data)


def calling(app: FastAPI) -> httpx.AsyncClient:
    transport = httpx.ASGITransport(app, raise_app_exceptions=False)
    return httpx.AsyncClient(transport=transport, base_url="http://test")


def leaves(base: type[ServiceError] = ServiceError) -> set[type[ServiceError]]:
    """Classes of services.errors that have no class below them there."""
    below = [kind for kind in base.__subclasses__() if kind.__module__ == errors.__name__]
    return set().union(*map(leaves, below)) if below else {base}


@pytest.mark.parametrize("kind", WIRE, ids=lambda kind: kind.__name__)
def test_an_error_is_answered_as_ever(kind: type[SceneError]):
    problem = problem_of(raised(kind))
    assert (problem.status, problem.type) == (WIRE[kind][0], f"urn:metanerf:{WIRE[kind][1]}")
    assert problem.title == WIRE[kind][1].replace("-", " ").capitalize()
    assert problem.detail == "the rule; got x; mend it"


def test_every_leaf_is_listed_once():
    listed = Counter(kind for names in problems.NAMES.values() for kind in names)
    assert set(listed.values()) == {1}
    assert leaves() <= listed.keys()
    assert leaves() <= WIRE.keys()


def test_every_class_says_when_it_is_raised():
    found = [kind for _, kind in inspect.getmembers(errors, inspect.isclass)]
    assert all(kind.__doc__ for kind in found)


def test_a_class_that_is_not_listed_is_answered_as_its_base():
    class Special(errors.MeetingFull):
        pass

    class NewReason(errors.Forbidden):
        pass

    assert KINDS.keys().isdisjoint({Special, NewReason})
    assert problem_of(Special("full")).type == "urn:metanerf:meeting-full"
    assert (problem_of(NewReason("no")).status, problem_of(NewReason("no")).title) == (
        403,
        "Forbidden",
    )


@pytest.mark.parametrize(
    ("kind", "headers"),
    [
        (errors.Unauthorized, {"WWW-Authenticate": "Bearer"}),
        (
            errors.ScopeMissing,
            {"WWW-Authenticate": 'Bearer error="insufficient_scope", scope="write"'},
        ),
        (errors.TooManyRequests, {"Retry-After": "7"}),
        (errors.NoSeatFree, {"Retry-After": "15"}),
        (errors.WrongOffset, {"Upload-Offset": "3", "Upload-Length": "9"}),
        (StoreAway, {"Retry-After": "3"}),
        (DatabaseAway, {"Retry-After": "3"}),
        (errors.JobOver, {}),
    ],
)
def test_what_an_error_carries_goes_into_the_header(
    kind: type[SceneError], headers: dict[str, str]
):
    assert headers_of(raised(kind)) == headers


def test_a_full_server_is_tried_again_in_five_seconds():
    assert headers_of(errors.ServerFull("full")) == {"Retry-After": "5"}


@pytest.mark.parametrize("kind", [KeyError, RuntimeError, ValueError])
def test_an_unforeseen_error_tells_no_secret(kind: type[Exception]):
    problem = problem_of(kind("secret"))
    assert (problem.status, problem.type) == (500, "urn:metanerf:internal-error")
    assert problem.detail == f"the server failed ({kind.__name__}); its log says more"


def test_a_failed_job_keeps_the_whole_problem():
    assert stored_failure(errors.WorkerDied("a job's process must live; it died 3 times")) == {
        "type": "urn:metanerf:worker-died",
        "title": "Worker died",
        "status": 500,
        "detail": "a job's process must live; it died 3 times",
    }
    full = stored_failure(OSError(errno.ENOSPC, "in the system's words"))
    assert (full["status"], full["type"]) == (507, "urn:metanerf:no-space-left")
    assert "free some and retry" in full["detail"]


async def _not_told(_request: Request, error: Exception) -> None:
    raise AssertionError(f"nobody was refused; got {error}")


async def test_an_application_answers_each_error_by_its_problem():
    app = FastAPI()
    problems.install(app, _not_told)

    @app.get("/refused")
    def refuse() -> None:
        raise raised(errors.WrongOffset)

    @app.get("/failed")
    def break_down() -> None:
        raise KeyError("secret")

    async with calling(app) as client:
        refused, failed = await client.get("/refused"), await client.get("/failed")
        missing = await client.get("/missing")
    assert refused.headers["content-type"] == "application/problem+json"
    assert (refused.headers["upload-offset"], refused.headers["upload-length"]) == ("3", "9")
    assert refused.json() == problem_of(raised(errors.WrongOffset)).model_dump()
    assert (failed.status_code, "secret" in failed.text) == (500, False)
    assert (missing.status_code, missing.json()["type"]) == (404, "urn:metanerf:not-found")


async def test_an_error_while_a_body_is_read_is_answered_as_any_other():
    app = FastAPI()
    problems.install(app, _not_told)
    app.add_middleware(LimitBodies)

    @app.post("/posted")
    def post(body: dict[str, str]) -> None:
        raise AssertionError(body)

    async with calling(app) as client:
        answer = await client.post("/posted", json={"a": "b" * LARGEST_BODY_BYTES})
    assert (answer.status_code, answer.json()["type"]) == (413, "urn:metanerf:too-large")
