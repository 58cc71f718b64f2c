"""What a viewer's SDP offer may ask for, and how it is answered."""

from __future__ import annotations

from contextlib import suppress

from aiortc import RTCPeerConnection, RTCRtpSender, RTCRtpTransceiver, RTCSessionDescription

from services.errors import MeetingSealed, OfferRefused
from services.live.sessions.voice_offer import media_of
from services.live.streaming.encoding import Codec

_MOST_SECTIONS = 8
"""Each takes sockets before it is known whether they share one."""
_NO_PICTURES = (
    "an offer for a sealed meeting must be of data channels alone; got one of pictures: this "
    "server cannot read how people move there, so it neither draws them nor shows live look; join "
    "by the page, with the whole link"
)


def require_no_media(sdp_offer: str) -> None:
    """Raise MeetingSealed for an offer of pictures or sound; what is no SDP is refused later."""
    with suppress(OfferRefused):
        if any(one.kind in ("audio", "video") for one in media_of(sdp_offer)):
            raise MeetingSealed(_NO_PICTURES)


def require_few_sections(sdp_offer: str) -> None:
    """Raise OfferRefused for an offer of more than anybody needs, or what is no SDP."""
    sections = len(media_of(sdp_offer))
    if sections > _MOST_SECTIONS:
        raise OfferRefused(
            f"an offer must have at most {_MOST_SECTIONS} sections; got {sections}; ask for one "
            "video"
        )


def prefer(transceiver: RTCRtpTransceiver, codec: Codec) -> None:
    """Have `codec` negotiated; counts only before the remote description is set."""
    codecs = RTCRtpSender.getCapabilities("video").codecs
    wanted = (f"video/{codec}", "video/rtx")
    transceiver.setCodecPreferences([c for c in codecs if c.mimeType in wanted])


async def answer(connection: RTCPeerConnection, sdp_offer: str) -> str:
    """The answer by the transceivers that `connection` has; nothing else is received.

    aiortc would take, and decode in this process, whatever else an offer sends.
    """
    ours = connection.getTransceivers()
    await connection.setRemoteDescription(RTCSessionDescription(sdp_offer, "offer"))
    for other in connection.getTransceivers():
        if other not in ours:
            other.direction = "inactive"
    await connection.setLocalDescription(await connection.createAnswer())
    return connection.localDescription.sdp
