"""What an offer to talk may ask for, told from its SDP before anything is made for it."""

from __future__ import annotations

from enum import Enum
from typing import Literal

from aiortc.sdp import SessionDescription

from services.live.sessions.view_sessions import OfferRefused
from services.live.streaming.voice_slots import SLOTS

Direction = Literal["sendrecv", "sendonly", "recvonly", "inactive"]
_REVERSED: dict[str, Direction] = {
    "sendrecv": "sendrecv",
    "sendonly": "recvonly",
    "recvonly": "sendonly",
    "inactive": "inactive",
}


class Door(Enum):
    """By which way somebody comes."""

    VOICE = "voice"
    """A page: microphone up, voices and a shared screen down."""
    WHIP = "whip"
    """A client that only sends (RFC 9725): a microphone, a screen."""


def read_sections(sdp_offer: str, door: Door) -> list[tuple[str, Direction]]:
    """Kind and the server's direction of each section of an offer, in order.

    Raises OfferRefused for an SDP that none can read, or that asks for more than `door` has.
    """
    try:
        media = SessionDescription.parse(sdp_offer).media
    except Exception as error:  # the parser throws whatever a line made it stumble with
        reason = str(error) or type(error).__name__
        raise OfferRefused(
            f"the offer must be an SDP; got one that can't be read: {reason}"
        ) from error
    sections: list[tuple[str, Direction]] = [
        (one.kind, _REVERSED[one.direction or "sendrecv"]) for one in media
    ]
    up = [kind for kind, direction in sections if direction in ("recvonly", "sendrecv")]
    down = [kind for kind, direction in sections if direction in ("sendonly", "sendrecv")]
    most = _MOST[door]
    asked = (up.count("audio"), up.count("video"), down.count("audio"), down.count("video"))
    known = all(kind in ("audio", "video") for kind, _ in sections)
    too_much = any(got > may for got, may in zip(asked, most, strict=True))
    if not sections or not known or too_much or len(sections) > sum(most):
        kinds = ", ".join(f"{one.kind} {one.direction}" for one in media[:20]) or "none"
        raise OfferRefused(f"the offer must be of {_WORDS[door]}; got sections {kinds}")
    return sections


_MOST = {Door.VOICE: (1, 0, SLOTS, 1), Door.WHIP: (1, 1, 0, 0)}
"""Sections that send audio and video, that receive audio and video, as the client sees it."""
_WORDS = {
    Door.VOICE: f"at most one audio that sends, {SLOTS} that receive, and one video that receives",
    Door.WHIP: "at most one audio and one video, both sendonly",
}
