"""What an SDP offer for a voice connection may ask for, read before anything is created for it."""

from __future__ import annotations

from enum import Enum
from typing import Literal

from services.errors import OfferRefused
from services.live.aiortc_compat import MediaDescription, SessionDescription
from services.live.streaming.voice_slots import SLOTS

Direction = Literal["sendrecv", "sendonly", "recvonly", "inactive"]
_REVERSED: dict[str, Direction] = {
    "sendrecv": "sendrecv",
    "sendonly": "recvonly",
    "recvonly": "sendonly",
    "inactive": "inactive",
}


class Endpoint(Enum):
    """The HTTP endpoint to which an offer was posted."""

    VOICE = "voice"
    """A page: a microphone up, voices and a shared screen down."""
    WHIP = "whip"
    """A client that only sends (RFC 9725): a microphone, a screen."""


def media_of(sdp_offer: str) -> list[MediaDescription]:
    """The sections of an offer. Raises OfferRefused for an SDP that can't be parsed."""
    try:
        return SessionDescription.parse(sdp_offer).media
    except Exception as error:  # the parser raises errors of many types
        reason = str(error) or type(error).__name__
        raise OfferRefused(
            f"the offer must be an SDP; got one that can't be read: {reason}"
        ) from error


def read_media_sections(sdp_offer: str, endpoint: Endpoint) -> list[tuple[str, Direction]]:
    """Kind and the server's direction of each media section of an offer, in order.

    Raises OfferRefused for an SDP that can't be parsed, or that asks for more than `endpoint`
    offers.
    """
    media = media_of(sdp_offer)
    sections: list[tuple[str, Direction]] = [
        (one.kind, _REVERSED[one.direction or "sendrecv"]) for one in media
    ]
    up = [kind for kind, direction in sections if direction in ("recvonly", "sendrecv")]
    down = [kind for kind, direction in sections if direction in ("sendonly", "sendrecv")]
    limits = _LIMITS[endpoint]
    counts = (up.count("audio"), up.count("video"), down.count("audio"), down.count("video"))
    only_media = all(kind in ("audio", "video") for kind, _ in sections)
    too_many = any(count > limit for count, limit in zip(counts, limits, strict=True))
    if not sections or not only_media or too_many or len(sections) > sum(limits):
        kinds = ", ".join(f"{one.kind} {one.direction}" for one in media[:20]) or "none"
        raise OfferRefused(f"the offer must be of {_RULES[endpoint]}; got sections {kinds}")
    return sections


_LIMITS = {Endpoint.VOICE: (1, 0, SLOTS, 1), Endpoint.WHIP: (1, 1, 0, 0)}
"""Most sections that send audio and video, that receive audio and video, as the client sees it."""
_RULES = {
    Endpoint.VOICE: (
        f"at most one audio that sends, {SLOTS} that receive, and one video that receives"
    ),
    Endpoint.WHIP: "at most one audio and one video, both sendonly",
}
