"""SDP over HTTP as in WHIP (RFC 9725) and WHEP (draft-ietf-wish-whep): what all endpoints share.

`POST` of an SDP offer (`application/sdp`) to an endpoint creates a session: 201 with the answer,
`Location` of the session resource, `ETag`, and a `Link` for each ICE server; 307 with the same
endpoint's `Location` at the meeting's home (RFC 9725, section 4.5; services.homes). `PATCH` of the
session resource with candidates (`application/trickle-ice-sdpfrag`, RFC 8840) under
`If-Match: ETAG`: 204.
ICE restarts (RFC 8445) are rejected (422): a client that lost its connection posts a new offer.
`DELETE` of the session resource ends it: 200, and 204 once it has ended.
"""

from __future__ import annotations

import re
from typing import Any, Protocol

from aiortc import RTCIceCandidate, RTCPeerConnection
from fastapi import Request, Response, status

from db.errors import NotFound
from scene.errors import InvalidInput
from services.auth import Principal
from services.container import Services
from services.errors import (
    BadCandidate,
    NoIceRestart,
    PreconditionFailed,
    PreconditionRequired,
    TooLarge,
    UnsupportedMediaType,
)
from services.live.aiortc_compat import candidate_from_sdp
from services.live.ice_servers import IceServer, ice_servers
from services.problems import problems

SDP = "application/sdp"
SDP_FRAGMENT = "application/trickle-ice-sdpfrag"
MAX_OFFER_BYTES = 64 * 1024
CREATED: dict[int | str, dict[str, Any]] = {
    201: {"content": {SDP: {}}, "description": "The SDP answer."},
    **problems(307),
}
"""What an endpoint answers to an offer that it takes, or sends elsewhere."""
_MAX_FRAGMENT_BYTES = 16 * 1024
_MAX_CANDIDATES = 64
"""In one request; each is an address to which the server then sends a few packets."""
_UFRAG = re.compile(r"^a=ice-ufrag:(\S+)", re.MULTILINE)
_RTCP_MUX_ONLY = "a=rtcp-mux-only"


class Session(Protocol):
    """A session that an SDP offer created."""

    @property
    def meeting_id(self) -> str:
        """The meeting that it is part of."""
        ...

    @property
    def participant_id(self) -> str | None:
        """The participant whose session it is; None for a viewer without a seat."""
        ...

    @property
    def connection(self) -> RTCPeerConnection:
        """Its WebRTC connection."""
        ...


class Sessions(Protocol):
    """The sessions of one kind."""

    def find(self, session_id: str) -> Session | None:
        """A running session."""
        ...

    async def close(self, session_id: str) -> bool:
        """End a session; False where there is none of that id."""
        ...


async def read_offer(request: Request) -> str:
    """The SDP offer in a request's body. Raises UnsupportedMediaType, TooLarge, InvalidInput."""
    text = await _read(request, SDP, MAX_OFFER_BYTES)
    # RFC 8858: a client may offer rtcp-mux-only alone, but aiortc reads only rtcp-mux
    sections = re.split(r"(?m)^(?=m=)", text)
    return "".join(
        section.replace(_RTCP_MUX_ONLY, f"a=rtcp-mux\r\n{_RTCP_MUX_ONLY}", 1)
        if _RTCP_MUX_ONLY in section and not re.search(r"(?m)^a=rtcp-mux\s*$", section)
        else section
        for section in sections
    )


def created(
    services: Services, caller: Principal, location: str, session_id: str, answer: str
) -> Response:
    """201 with the SDP answer and the location of the session resource."""
    response = Response(_add_rtcp_mux_only(answer), status.HTTP_201_CREATED, media_type=SDP)
    response.headers["Location"] = location
    response.headers["ETag"] = f'"{session_id}"'
    response.headers["Accept-Patch"] = SDP_FRAGMENT
    holder = caller.participant_id or "viewer"
    for server in ice_servers(services.settings.live, holder, services.clock()):
        for url in server.urls:
            response.headers.append("Link", _ice_server_link(url, server))
    return response


def _ice_server_link(url: str, server: IceServer) -> str:
    """As in RFC 9725, section 4.6."""
    link = f'<{url}>; rel="ice-server"'
    if server.username:
        link += f'; username="{server.username}"; credential="{server.credential}"'
        link += '; credential-type="password"'
    return link


def _add_rtcp_mux_only(answer: str) -> str:
    """`answer` with `a=rtcp-mux-only` (RFC 8858): RTP and RTCP must share a port."""
    return answer.replace("a=rtcp-mux\r\n", f"a=rtcp-mux\r\n{_RTCP_MUX_ONLY}\r\n")


def options(allow: str) -> Response:
    """Response to OPTIONS: the methods and types of an endpoint; CORS is answered before."""
    headers = {"Allow": allow}
    if "POST" in allow:
        headers["Accept-Post"] = SDP
    if "PATCH" in allow:
        headers["Accept-Patch"] = SDP_FRAGMENT
    return Response(status_code=status.HTTP_204_NO_CONTENT, headers=headers)


def own_session(sessions: Sessions, session_id: str, meeting_id: str, caller: Principal) -> Session:
    """The session, if it is the caller's. Raises OtherMeeting, NotFound."""
    caller.require_meeting(meeting_id)
    found = sessions.find(session_id)
    if (
        found is None
        or found.meeting_id != meeting_id
        or found.participant_id != caller.participant_id
    ):
        raise NotFound(
            f"id must be that of a running session of yours; got {session_id!r}; it may have "
            "ended already",
        )
    return found


async def end_session(
    sessions: Sessions, session_id: str, meeting_id: str, caller: Principal
) -> Response:
    """End the caller's session: 200, or 204 where it has ended already.

    DELETE is idempotent (RFC 9110, section 9.2.2), and a client cannot know what the server has
    ended meanwhile. Ids are not remembered, so that one that never was is answered alike.
    Raises OtherMeeting, and NotFound for another's session.
    """
    caller.require_meeting(meeting_id)
    if sessions.find(session_id) is None:
        return Response(status_code=status.HTTP_204_NO_CONTENT)
    own_session(sessions, session_id, meeting_id, caller)
    await sessions.close(session_id)
    return Response(status_code=status.HTTP_200_OK)


async def add_candidates(request: Request, session: Session, session_id: str) -> Response:
    """Trickle ICE: add a request's candidates. Raises the errors of RFC 9725, section 4.3."""
    _require_match(request.headers.get("if-match"), session_id)
    text = await _read(request, SDP_FRAGMENT, _MAX_FRAGMENT_BYTES)
    expected = _UFRAG.search(session.connection.remoteDescription.sdp)
    received = _UFRAG.search(text)
    if received and expected and received[1] != expected[1]:
        raise reject_ice_restart(f"another ice-ufrag, {received[1][:40]!r}")
    for candidate in _candidates(text):
        await session.connection.addIceCandidate(candidate)
    if "a=end-of-candidates" in text:
        await session.connection.addIceCandidate(None)
    return Response(status_code=status.HTTP_204_NO_CONTENT)


def _require_match(if_match: str | None, session_id: str) -> None:
    if if_match is None:
        raise PreconditionRequired(
            "a PATCH must carry `If-Match` with the session's ETag; got none",
        )
    if if_match.strip() == "*":
        raise reject_ice_restart("`If-Match: *`")
    if if_match.strip() != f'"{session_id}"':
        raise PreconditionFailed(
            f"If-Match must be the ETag of this session; got {if_match[:80]!r}; it may be that of "
            "one before",
        )


def reject_ice_restart(got: str) -> NoIceRestart:
    """The error of a PATCH that asks for an ICE restart (RFC 8445, section 9)."""
    return NoIceRestart(
        f"a PATCH must bring candidates of the offer's own ICE session; got {got}, which asks for "
        "a restart; end this session and post a new offer",
    )


def _candidates(text: str) -> list[RTCIceCandidate]:
    found: list[RTCIceCandidate] = []
    mid, line_index = None, -1
    for line in text.splitlines():
        if line.startswith("m="):
            mid, line_index = None, line_index + 1
        elif line.startswith("a=mid:"):
            mid = line.removeprefix("a=mid:").strip()
        elif line.startswith("a=candidate:"):
            try:
                candidate = candidate_from_sdp(line.removeprefix("a=candidate:"))
            except (ValueError, IndexError, AssertionError) as error:
                raise BadCandidate(
                    f"a candidate must be as in RFC 8839; got {line[:120]!r}"
                ) from error
            candidate.sdpMid = mid
            candidate.sdpMLineIndex = max(0, line_index)
            found.append(candidate)
    if len(found) > _MAX_CANDIDATES:
        raise TooLarge(
            f"a fragment must bring at most {_MAX_CANDIDATES} candidates; got {len(found)}",
        )
    return found


async def _read(request: Request, media_type: str, max_bytes: int) -> str:
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind != media_type:
        raise UnsupportedMediaType(
            f"the body must be of type {media_type}; got {kind or 'none'!r}",
        )
    body = bytearray()
    async for chunk in request.stream():
        body += chunk
        if len(body) > max_bytes:
            raise TooLarge(f"the body must be at most {max_bytes} bytes; got more")
    try:
        return body.decode()
    except UnicodeDecodeError as error:
        raise InvalidInput(f"the body must be UTF-8; got {error}") from error
