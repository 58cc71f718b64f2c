"""A seat in a meeting, taken over HTTP, and whom its owner drives there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any
from urllib.parse import parse_qs, urlsplit

import httpx

from scene.errors import InvalidInput, SceneError

_TIMEOUT_S = 20.0


class NotJoined(SceneError):
    """The meeting cannot be joined, or had to be left."""


class MeetingAway(NotJoined):
    """The meeting's server does not answer now; in a moment, it or another may."""


@dataclass(frozen=True)
class MeetingLink:
    """A meeting, as the link to it says."""

    server: str
    meeting_id: str | None
    """None: the demo's."""
    token: str | None
    """The invitation's."""

    @classmethod
    def parse(cls, link: str) -> MeetingLink:
        """Of `http://host/?meeting=ID#token=TOKEN`. Raises InvalidInput."""
        parts = urlsplit(link)
        if parts.scheme not in ("http", "https") or not parts.netloc:
            raise InvalidInput(
                "the meeting must be the link that brings people into it, such as "
                f"http://host:8000/?meeting=ID; got {link!r}; copy it from the meeting's page"
            )
        (meeting_id,) = parse_qs(parts.query).get("meeting", [None])
        (token,) = parse_qs(parts.fragment).get("token", [None])
        return cls(f"{parts.scheme}://{parts.netloc}", meeting_id, token)


@dataclass(frozen=True)
class Seat:
    """What its owner needs to be in the meeting, and to be there again after an outage."""

    server: str
    """By which they came, as scheme and host."""
    meeting_id: str
    gateway_url: str
    """Where the meeting lived then; empty: at the server."""
    token: str
    ice_servers: list[dict[str, Any]]
    """As in `RTCConfiguration`."""
    performer_id: str
    performer_name: str

    def whep_url(self, gateway_url: str) -> str:
        """Where to be driven from while the meeting lives at `gateway_url`."""
        return f"{gateway_url or self.server}/whep/{self.meeting_id}"


def take_seat(
    link: MeetingLink, token: str | None, name: str, performer: str | None, *, live_look: bool
) -> Seat:
    """Join as `name`, to drive `performer` (a name or id; None: one's own, or one that is lent).

    Without a token the invitation's or a guest's is used. Raises NotJoined with what the server
    said, and InvalidInput where nobody may be driven so.
    """
    with httpx.Client(base_url=link.server, timeout=_TIMEOUT_S) as client:
        known = token or link.token or _ask(client, "POST", "/v1/guest")["token"]
        client.headers["Authorization"] = f"Bearer {known}"
        meeting_id = link.meeting_id or _ask(client, "GET", "/v1/demo")["meeting_id"]
        if meeting_id is None:
            raise InvalidInput(
                f"the link must name a meeting; got {link.server}, which runs no demo; add "
                "?meeting=ID"
            )
        seat = _ask(client, "POST", f"/v1/meetings/{meeting_id}/join", json={"display_name": name})
    driven = _driven(seat["performers"], performer, live_look=live_look)
    return Seat(
        link.server,
        meeting_id,
        seat["gateway_url"],
        seat["token"],
        seat["ice_servers"],
        driven["id"],
        driven["name"],
    )


def _driven(
    performers: list[dict[str, Any]], asked: str | None, *, live_look: bool
) -> dict[str, Any]:
    """Whom to drive: of those who may be, one's own first."""
    named = [one for one in performers if asked is None or asked in (one["id"], one["name"])]
    if live_look:
        able, rule = [one for one in named if one["owner"] == "own"], "of your own, for live look"
    else:
        able = [one for one in named if one["drivable"]]
        rule = "that you may drive"
    if not able:
        there = ", ".join(one["name"] for one in performers) or "nobody"
        raise InvalidInput(
            f"the meeting must show a model {rule}; got {there}; bring yours into it, name it by "
            "--performer, and give your account's --token"
        )
    return min(able, key=lambda one: one["owner"] != "own")


def _ask(client: httpx.Client, method: str, path: str, **options: Any) -> dict[str, Any]:
    try:
        answer = client.request(method, path, **options)
    except httpx.TransportError as error:
        raise MeetingAway(
            "the meeting's server must answer; got nothing from "
            f"{client.base_url} ({error or type(error).__name__})"
        ) from error
    if not answer.is_success:
        raise refusal(answer)
    return answer.json()


def refusal(answer: httpx.Response) -> NotJoined:
    """What is wrong, by what the server answered."""
    away = answer.is_server_error or answer.is_redirect
    return (MeetingAway if away else NotJoined)(told(answer))


def told(answer: httpx.Response) -> str:
    """What the server said, in its own words (RFC 9457) where it has any."""
    try:
        body = answer.json()
        return f"{body['title']} ({answer.status_code}): {body['detail']}"
    except (ValueError, KeyError, TypeError):
        return f"the server answered {answer.status_code}"
