"""SDP over HTTP, as WHIP (RFC 9725) and WHEP (draft-ietf-wish-whep) have it: what all doors share.

`POST` an offer (`application/sdp`): 201 with the answer, `Location`, `ETag` and a `Link` an ICE
server. `PATCH` the location with candidates (`application/trickle-ice-sdpfrag`, RFC 8840) under
`If-Match: ETAG`: 204. There are no ICE restarts (422): who loses the connection posts anew.
`DELETE` ends it.
"""

from __future__ import annotations

import re
from typing import Protocol

from aiortc import RTCIceCandidate, RTCPeerConnection
from aiortc.sdp import candidate_from_sdp
from fastapi import Request, Response, status

from services.auth import Principal
from services.problems import ProblemError

SDP = "application/sdp"
FRAGMENT = "application/trickle-ice-sdpfrag"
LARGEST_OFFER_BYTES = 64 * 1024
_LARGEST_FRAGMENT_BYTES = 16 * 1024
_MOST_CANDIDATES = 64
"""Of one request; each is an address that the server then sends a few packets to."""
_UFRAG = re.compile(r"^a=ice-ufrag:(\S+)", re.MULTILINE)
_MUX_ONLY = "a=rtcp-mux-only"


class Session(Protocol):
    """A connection that an offer opened."""

    @property
    def meeting_id(self) -> str:
        """Where it looks, or talks."""
        ...

    @property
    def participant_id(self) -> str | None:
        """The seat of its owner; none for who came without one."""
        ...

    @property
    def connection(self) -> RTCPeerConnection:
        """Its WebRTC connection."""
        ...


class Sessions(Protocol):
    """The connections of one kind of door."""

    def find(self, session_id: str) -> Session | None:
        """A running session."""
        ...

    async def close(self, session_id: str) -> bool:
        """End one; False when there is none of that id."""
        ...


async def read_offer(request: Request) -> str:
    """The SDP that a request brings. Raises a 413, 415 or 422 problem."""
    text = await _read(request, SDP, LARGEST_OFFER_BYTES)
    # RFC 8858: a client that can do nothing else says so, and aiortc knows the older word alone
    sections = re.split(r"(?m)^(?=m=)", text)
    return "".join(
        section.replace(_MUX_ONLY, f"a=rtcp-mux\r\n{_MUX_ONLY}", 1)
        if _MUX_ONLY in section and not re.search(r"(?m)^a=rtcp-mux\s*$", section)
        else section
        for section in sections
    )


def created(location: str, session_id: str, answer: str, ice_servers: list[str]) -> Response:
    """201: the answer, and where its session is found."""
    response = Response(answer, status.HTTP_201_CREATED, media_type=SDP)
    response.headers["Location"] = location
    response.headers["ETag"] = f'"{session_id}"'
    response.headers["Accept-Patch"] = FRAGMENT
    for url in ice_servers:
        response.headers.append("Link", f'<{url}>; rel="ice-server"')
    return response


def mux_only(answer: str) -> str:
    """`answer` saying that RTP and RTCP share a port and can't do without (RFC 8858)."""
    return answer.replace("a=rtcp-mux\r\n", f"a=rtcp-mux\r\n{_MUX_ONLY}\r\n")


def options(allow: str) -> Response:
    """What a door takes, told to whoever asks; CORS is answered before that."""
    headers = {"Allow": allow}
    if "POST" in allow:
        headers["Accept-Post"] = SDP
    if "PATCH" in allow:
        headers["Accept-Patch"] = FRAGMENT
    return Response(status_code=status.HTTP_204_NO_CONTENT, headers=headers)


def session_of(sessions: Sessions, session_id: str, meeting_id: str, caller: Principal) -> Session:
    """The caller's own session. Raises a 403 or 404 problem."""
    caller.require_meeting(meeting_id)
    found = sessions.find(session_id)
    if (
        found is None
        or found.meeting_id != meeting_id
        or found.participant_id != caller.participant_id
    ):
        raise ProblemError(
            404,
            "not-found",
            f"id must be that of a running session of yours; got {session_id!r}; it may have "
            "ended already",
        )
    return found


async def end(sessions: Sessions, session_id: str, meeting_id: str, caller: Principal) -> Response:
    """End the caller's session."""
    session_of(sessions, session_id, meeting_id, caller)
    await sessions.close(session_id)
    return Response(status_code=status.HTTP_200_OK)


async def trickle(request: Request, session: Session, session_id: str) -> Response:
    """Take the candidates that a request brings. Raises the problems that RFC 9725, 4.3 lists."""
    _require_match(request.headers.get("if-match"), session_id)
    text = await _read(request, FRAGMENT, _LARGEST_FRAGMENT_BYTES)
    known = _UFRAG.search(session.connection.remoteDescription.sdp)
    told = _UFRAG.search(text)
    if told and known and told[1] != known[1]:
        raise _no_restart(f"another ice-ufrag, {told[1][:40]!r}")
    for candidate in _candidates(text):
        await session.connection.addIceCandidate(candidate)
    if "a=end-of-candidates" in text:
        await session.connection.addIceCandidate(None)
    return Response(status_code=status.HTTP_204_NO_CONTENT)


def _require_match(if_match: str | None, session_id: str) -> None:
    if if_match is None:
        raise ProblemError(
            428,
            "precondition-required",
            "a PATCH must carry `If-Match` with the session's ETag; got none",
        )
    if if_match.strip() == "*":
        raise _no_restart("`If-Match: *`")
    if if_match.strip() != f'"{session_id}"':
        raise ProblemError(
            412,
            "precondition-failed",
            f"If-Match must be the ETag of this session; got {if_match[:80]!r}; it may be that of "
            "one before",
        )


def _no_restart(got: str) -> ProblemError:
    return ProblemError(
        422,
        "no-ice-restart",
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
                raise ProblemError(
                    400, "bad-candidate", f"a candidate must be as in RFC 8839; got {line[:120]!r}"
                ) from error
            candidate.sdpMid = mid
            candidate.sdpMLineIndex = max(0, line_index)
            found.append(candidate)
    if len(found) > _MOST_CANDIDATES:
        raise ProblemError(
            413,
            "too-large",
            f"a fragment must bring at most {_MOST_CANDIDATES} candidates; got {len(found)}",
        )
    return found


async def _read(request: Request, wanted: str, most_bytes: int) -> str:
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind != wanted:
        raise ProblemError(
            415,
            "unsupported-media-type",
            f"the body must be of type {wanted}; got {kind or 'none'!r}",
        )
    body = bytearray()
    async for chunk in request.stream():
        body += chunk
        if len(body) > most_bytes:
            raise ProblemError(
                413, "too-large", f"the body must be at most {most_bytes} bytes; got more"
            )
    try:
        return body.decode()
    except UnicodeDecodeError as error:
        raise ProblemError(422, "invalid-input", f"the body must be UTF-8; got {error}") from error
