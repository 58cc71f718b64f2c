"""What each route answers to each caller: about what is Ada's, and about what is Cy's.

`OK` stands for what the route answers when it does what it was asked; where nothing real can be
sent, as an offer of WebRTC, it is the refusal that only somebody who may ask comes to see.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from tests.services.api.authorisation_world import Caller

OK = 0
SDP = {"content-type": "application/sdp"}


@dataclass(frozen=True)
class Answers:
    """The expected status of every caller."""

    own: dict[Caller, int]
    foreign: dict[Caller, int]


@dataclass(frozen=True)
class Row:
    """A route, how it is called, and what it answers."""

    route: str
    answers: Answers
    ok: int = 200
    """The status that `OK` stands for."""
    path: str = ""
    """Where the route's own path does not name what is meant."""
    request: dict[str, Any] = field(default_factory=dict)


def _callers(text: str) -> dict[Caller, int]:
    """Statuses in the order of `Caller`."""
    statuses = [OK if word == "ok" else int(word) for word in text.split()]
    return dict(zip(Caller, statuses, strict=True))


def answers(own: str, foreign: str) -> Answers:
    return Answers(_callers(own), _callers(foreign))


#                      none guest other viewer speaker host former waiting removed expired elsewhere
PUBLIC = answers(
    "     ok  ok    ok    ok     ok      ok   ok     ok      ok      ok      ok",
    "     ok  ok    ok    ok     ok      ok   ok     ok      ok      ok      ok",
)
ACCOUNTS = answers(
    "   401 ok    ok    403    403     403  403    403     403     401     403",
    "   401 ok    ok    403    403     403  403    403     403     401     403",
)
"""Whoever has an account, whether as a guest or not; a seat's token is good for its meeting."""
ANYBODY = answers(
    "    401 ok    ok    ok     ok      ok   ok     ok      ok      401     ok",
    "    401 ok    ok    ok     ok      ok   ok     ok      ok      401     ok",
)
OWNER = answers(
    "      401 ok    403   403    403     403  403    403     403     401     403",
    "      401 403   403   403    403     403  403    403     403     401     403",
)
INVITED = answers(
    "    401 ok    ok    ok     ok      ok   ok     ok      403     401     403",
    "    401 ok    ok    403    403     403  403    403     403     401     403",
)
"""A meeting's id is its invitation, for whoever was not sent out."""
HOST = answers(
    "       401 ok    403   403    403     ok   403    403     403     401     403",
    "       401 403   403   403    403     403  403    403     403     401     403",
)
ADMITTED = answers(
    "   401 403   403   ok     ok      ok   ok     403     403     401     403",
    "   401 ok    ok    403    403     403  403    403     403     401     403",
)
"""Ada's meeting has its lobby on, Cy's has not."""
SEATED = answers(
    "     401 403   403   ok     ok      ok   ok     403     403     401     403",
    "     401 403   403   403    403     403  403    403     403     401     403",
)
SHOWN = answers(
    "      401 ok    403   ok     ok      ok   ok     403     403     401     403",
    "      401 403   403   403    403     403  403    403     403     401     403",
)
"""A model's owner, and whoever is in the meeting in which it stands."""
RECORDED = answers(
    "   401 ok    403   403    ok      403  ok     403     403     401     403",
    "   401 403   403   403    403     403  403    403     403     401     403",
)
NOT_THEIRS = answers(
    "    401 404   404   404    404     404  404    404     404     401     403",
    "    401 404   404   403    403     403  403    403     403     401     403",
)
"""A session that is none of the caller's."""
ENDED = answers(
    "      401 ok    ok    ok     ok      ok   ok     ok      ok      401     403",
    "      401 ok    ok    403    403     403  403    403     403     401     403",
)
"""Of a session of nobody's there is nothing left to end."""

_MODEL = {"json": {"model_id": "{model_id}"}}
_FORM = {"files": {"file": ("clip.mp4", b"no clip")}}
_UPLOAD = {"json": {"filename": "b.mp4", "size": 3, "sha256": "3" * 64}}
_OFFER = {"content": b"v=0", "headers": SDP}
_PIECE = {"content": b"", "headers": {"upload-offset": "0"}}
_VIEW = {"json": {"width": 16, "height": 16}}

_KEPT = "/whep/{meeting_id}/{session_id}/kept-frames"
ROWS = (
    Row("GET /healthz", PUBLIC),
    Row("GET /readyz", PUBLIC),
    Row("GET /metrics", PUBLIC),  # who may scrape is told apart by address: test_scraping
    Row("GET /openapi.json", PUBLIC),
    Row("GET /docs", PUBLIC),
    Row("GET /", PUBLIC),
    Row("POST /v1/guest", PUBLIC, 201),
    Row("GET /v1/access", PUBLIC),
    # without a provider nobody logs in; with one: test_login
    Row("GET /v1/login", PUBLIC, 403),
    Row("GET /v1/login/callback", PUBLIC, 403),
    Row("POST /v1/login/token", PUBLIC, 403),
    Row("GET /v1/logout", PUBLIC, 302),
    Row("GET /v1/demo", PUBLIC),
    Row("GET /v1/landmarks/model", PUBLIC),
    Row("GET /v1/landmarks/face-model", PUBLIC),
    Row("GET /v1/landmarks/hand-model", PUBLIC),
    Row("GET /v1/landmarks/solver", PUBLIC),
    Row("GET /v1/environments/{name}/picture", PUBLIC, path="/v1/environments/apartment/picture"),
    Row("OPTIONS /whep/{meeting_id}", PUBLIC, 204),
    Row("OPTIONS /whip/{meeting_id}", PUBLIC, 204),
    Row("GET /v1/environments", ANYBODY),
    Row("GET /v1/recordings", ANYBODY),
    Row("GET /v1/people", ACCOUNTS),
    Row("POST /v1/people", ACCOUNTS, 201, request={"json": {"name": "Eve"}}),
    Row("GET /v1/models", ACCOUNTS),
    Row("POST /v1/meetings", ACCOUNTS, 201, request={"json": {"name": "Tuesday"}}),
    Row("GET /v1/people/{person_id}", OWNER),
    Row("DELETE /v1/people/{person_id}", OWNER),
    Row("GET /v1/people/{person_id}/consent", OWNER),
    Row("PUT /v1/people/{person_id}/consent", OWNER, request={"json": {"purposes": ["meetings"]}}),
    Row("DELETE /v1/people/{person_id}/consent", OWNER),
    Row("POST /v1/people/{person_id}/sequences", OWNER, 422, request=_FORM),
    Row("POST /v1/people/{person_id}/uploads", OWNER, 201, request=_UPLOAD),
    Row("HEAD /v1/uploads/{upload_id}", OWNER),
    Row("PATCH /v1/uploads/{upload_id}", OWNER, 204, request=_PIECE),
    Row("DELETE /v1/uploads/{upload_id}", OWNER, 204),
    Row("GET /v1/sequences/{sequence_id}", OWNER),
    Row("GET /v1/sequences/{sequence_id}/thumbnail", OWNER),
    Row("POST /v1/sequences/{sequence_id}/models", OWNER, 202, request={"json": {}}),
    Row("DELETE /v1/sequences/{sequence_id}", OWNER, 204, path="/v1/sequences/{spare_id}"),
    Row("GET /v1/jobs/{job_id}", OWNER),
    Row("GET /v1/jobs/{job_id}/preview", OWNER),
    Row("GET /v1/jobs/{job_id}/events", OWNER),
    Row("POST /v1/jobs/{job_id}/resume", OWNER, 202),
    Row("DELETE /v1/jobs/{job_id}", OWNER, 202, path="/v1/jobs/{waiting_id}"),
    Row("GET /v1/models/{model_id}", OWNER),
    Row("GET /v1/models/{model_id}/files/viewer.splats", SHOWN),
    Row(
        "GET /v1/models/{model_id}/files/{name}",
        OWNER,
        path="/v1/models/{model_id}/files/model.safetensors",
    ),
    Row("POST /v1/models/{model_id}/views", OWNER, request=_VIEW),
    Row("GET /v1/meetings/{meeting_id}", INVITED),
    Row("GET /v1/meetings/{meeting_id}/home", INVITED),
    Row("POST /v1/meetings/{meeting_id}/join", INVITED, request={"json": {}}),
    Row("POST /v1/meetings/{meeting_id}/invitation", HOST),
    Row("POST /v1/meetings/{meeting_id}/performers", OWNER, 201, request=_MODEL),
    Row("DELETE /v1/meetings/{meeting_id}/performers/{performer_id}", OWNER, 204),
    Row("GET /v1/meetings/{meeting_id}/environment", INVITED),
    Row("PUT /v1/meetings/{meeting_id}/environment", HOST, request={"json": {"name": "studio"}}),
    Row("PUT /v1/meetings/{meeting_id}/panorama", HOST, 422, request={"content": b"no picture"}),
    Row("GET /v1/meetings/{meeting_id}/panorama", ADMITTED),
    Row("GET /v1/recordings/{recording_id}", RECORDED),
    Row("GET /v1/recordings/{recording_id}/tracks/{track}", RECORDED),
    Row("GET /v1/recordings/{recording_id}/voices/{participant_id}.ogg", RECORDED),
    Row("GET /v1/recordings/{recording_id}/models/{model_id}", RECORDED),
    Row("GET /v1/recordings/{recording_id}/place", RECORDED),
    Row("GET /v1/recordings/{recording_id}/place/picture", RECORDED),
    Row(
        "GET /v1/recordings/{recording_id}/videos/{job_id}",
        RECORDED,
        path="/v1/recordings/{recording_id}/videos/{video_id}",
    ),
    Row("POST /v1/recordings/{recording_id}/export", OWNER, 202, request={"json": {}}),
    Row("DELETE /v1/recordings/{recording_id}/mine", RECORDED),
    Row("DELETE /v1/recordings/{recording_id}", OWNER, 204),
    Row("POST /whep/{meeting_id}", ADMITTED, 422, request=_OFFER),
    Row("POST /whip/{meeting_id}", SEATED, 422, request=_OFFER),
    Row("POST /v1/meetings/{meeting_id}/voice", SEATED, 422, request=_OFFER),
    *(
        Row(f"PATCH {path}/{{session_id}}", NOT_THEIRS)
        for path in ("/whep/{meeting_id}", "/whip/{meeting_id}", "/v1/meetings/{meeting_id}/voice")
    ),
    *(
        Row(f"DELETE {path}/{{session_id}}", ENDED, 204)
        for path in ("/whep/{meeting_id}", "/whip/{meeting_id}", "/v1/meetings/{meeting_id}/voice")
    ),
    Row(f"GET {_KEPT}", NOT_THEIRS),
    Row(f"PUT {_KEPT}", NOT_THEIRS, request={"json": {"on": True}}),
    Row(f"POST {_KEPT}", NOT_THEIRS),
    Row(f"DELETE {_KEPT}", NOT_THEIRS),
)
"""Every route but the control channel, which is no HTTP."""

CONTROL = "WS /v1/meetings/{meeting_id}/control"
CONTROL_ANSWERS = answers(
    "                   401 403   403   ok     ok      ok   ok     ok      ok      401     403",
    "                   401 403   403   403    403     403  403    403     403     401     403",
)
"""Whoever waits is told so, and whoever was sent out is told that, on the channel itself."""

DRIVING = answers(
    "                   403 ok    403   403    403     403  ok     403     403     ok      403",
    "                   403 403   403   403    403     403  403    403     403     403     403",
)
"""Of the data channels `motion` and `keypoints`, and of pictures beside them, by the account of the
connection that they belong to: whether the connection may be is `POST /whep`'s to say."""
