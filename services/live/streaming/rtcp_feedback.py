"""What a viewer's RTCP feedback asks of their video."""

from __future__ import annotations

from services.live.aiortc_compat import (
    RTCP_PSFB_APP,
    RTCP_PSFB_FIR,
    RTCP_PSFB_PLI,
    AnyRtcpPacket,
    RtcpPsfbPacket,
    RtcpRrPacket,
    RtcpRtpfbPacket,
    unpack_remb_fci,
)
from services.live.streaming.view_track import ViewTrack


def apply_feedback(packet: AnyRtcpPacket, track: ViewTrack, ssrc: int) -> None:
    """Act on one RTCP packet about the stream `ssrc` of `track`.

    Key frame requests (PLI, FIR) and losses (NACK) are RFC 4585 and RFC 5104, bitrate estimates
    (REMB) draft-alvestrand-rmcat-remb, receiver reports RFC 3550. A NACK keeps only the packets
    that are worth retransmitting: aiortc retransmits all that it names, which is many times what a
    slow connection carries.
    """
    if isinstance(packet, RtcpRtpfbPacket):
        packet.lost = track.worth_resending(packet.lost)
    elif isinstance(packet, RtcpRrPacket) and track.wanted:
        for report in packet.reports:
            if report.ssrc == ssrc:
                track.bitrate.on_loss(report.fraction_lost / 256)
    elif isinstance(packet, RtcpPsfbPacket):
        _apply_payload_specific(packet, track)


def _apply_payload_specific(packet: RtcpPsfbPacket, track: ViewTrack) -> None:
    if packet.fmt in (RTCP_PSFB_PLI, RTCP_PSFB_FIR):
        track.request_key_frame()
    elif packet.fmt == RTCP_PSFB_APP:
        try:
            bitrate, _ = unpack_remb_fci(packet.fci)
        except ValueError:
            return  # another application's message
        track.bitrate.on_estimate(bitrate)
