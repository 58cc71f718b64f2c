"""Pictures to packets of video, by settings that suit rendered pictures.

There is no noise to take out, most of a picture rests, and a viewer waits for every frame: no
look-ahead, no B-frames, one thread, key frames only when somebody asks. Of what a browser offers
H.264 is taken first (RFC 6184, constrained baseline, packetization-mode 1): at equal quality it
costs less than VP8 (RFC 7741) here and in the browser; `metanerf bench serve` has the figures. Its
level is the picture's own: browsers offer 3.1 and decode more.
"""

from __future__ import annotations

from collections.abc import Sequence as Many
from enum import StrEnum
from fractions import Fraction

from av import CodecContext, Packet, VideoFrame
from av.video.codeccontext import VideoCodecContext
from av.video.frame import PictureType

FRAMES_PER_SECOND = 30
_CLOCK_RATE = 90_000
"""Of RTP's timestamps for video, Hz."""
_TICKS, _TIME_BASE = Fraction(1, FRAMES_PER_SECOND), Fraction(1, _CLOCK_RATE)
_FASTEST = 12
"""Of VP8's speeds."""
_NO_KEY_FRAMES = 1 << 20
"""Frames between key frames that nobody requested: half a day."""
BITRATES = (500_000, 750_000, 1_100_000, 1_700_000, 2_500_000, 4_000_000, 6_000_000)
"""bit/s. Few steps: a VP8 encoder must be opened anew, with a key frame, to change."""
_FIRST_BITRATE = 4
_CLIMB = 1.15
"""A step is climbed once the estimate is so much above it: estimates swing."""
_CONGESTED_LOSS, _FREE_LOSS = 0.1, 0.02
"""A connection that loses a larger share of packets is congested; one that loses less has room."""
_GROWTH = 1.08
"""Factor by which more is tried on a connection with room, from one report to the next."""


class Codec(StrEnum):
    """How video is coded; values are the names in SDP."""

    H264 = "H264"
    VP8 = "VP8"


class BitrateSteps:
    """The bitrate that gets through to a viewer, in steps with hysteresis.

    The receiver's estimate goes by delays (REMB); on a connection that drops packets instead of
    delaying them it stays high, and losses bound it, as in draft-ietf-rmcat-gcc, section 6.
    """

    def __init__(self) -> None:
        self._index = _FIRST_BITRATE
        self._estimate, self._bound = float(BITRATES[_FIRST_BITRATE]), _CLIMB * BITRATES[-1]

    @property
    def bitrate(self) -> int:
        """bit/s to encode with."""
        return BITRATES[self._index]

    def on_estimate(self, bitrate: float) -> None:
        """Take the receiver's estimate, bit/s (REMB)."""
        self._estimate = bitrate
        self._settle()

    def on_loss(self, share: float) -> None:
        """Take the share of packets, 0 to 1, that was lost since the last report."""
        if share > _CONGESTED_LOSS:
            bound = (1.0 - 0.5 * share) * min(self._bound, self.bitrate)
            self._bound = max(bound, float(BITRATES[0]))
        elif share < _FREE_LOSS:
            self._bound = min(_GROWTH * self._bound, _CLIMB * BITRATES[-1])
        self._settle()

    def _settle(self) -> None:
        bitrate = min(self._estimate, self._bound)
        while self._index > 0 and bitrate < BITRATES[self._index]:
            self._index -= 1
        last = len(BITRATES) - 1
        while self._index < last and bitrate >= _CLIMB * BITRATES[self._index + 1]:
            self._index += 1


class PictureEncoder:
    """One viewer's stream. Encodes in the thread that calls, which must be one at a time."""

    def __init__(self, codec: Codec, vp8_speed: int = _FASTEST) -> None:
        """`vp8_speed`: up to 12; slower ones look better at the same bitrate."""
        self._codec, self._vp8_speed = codec, vp8_speed
        self._context: VideoCodecContext | None = None
        self._opened: tuple[int, int, int] = (0, 0, 0)
        """Width, height and bitrate of the open context."""

    def encode(self, frame: VideoFrame, tick: int, bitrate: int, *, key: bool) -> Packet:
        """`frame` (yuv420p) as one access unit, shown at `tick` (1/30 s, rising).

        With `key`, or after a change of size, it needs no frame before it.
        """
        wanted = (frame.width, frame.height, bitrate)
        if self._context is None or self._opened != wanted:
            self._context = self._open(*wanted)
            self._opened = wanted
        # set each time: viewers of one picture share the frame, not their requests
        frame.pict_type = PictureType.I if key else PictureType.NONE
        frame.pts, frame.time_base = tick, _TICKS
        packets = self._context.encode(frame)
        return timed(packets[0] if len(packets) == 1 else _concatenated(packets), tick)

    def release(self) -> None:
        """Give back what encoding holds, some 15 MiB; the next picture begins anew."""
        self._context = None

    def _open(self, width: int, height: int, bitrate: int) -> VideoCodecContext:
        same_size = self._opened[:2] == (width, height)
        if self._codec is Codec.H264 and self._context is not None and same_size:
            # libx264 takes a new bitrate in its stride
            self._context.bit_rate = bitrate
            return self._context
        name = "libx264" if self._codec is Codec.H264 else "libvpx"
        context: VideoCodecContext = CodecContext.create(name, "w")
        context.width, context.height, context.pix_fmt = width, height, "yuv420p"
        context.bit_rate, context.gop_size, context.thread_count = bitrate, _NO_KEY_FRAMES, 1
        context.time_base, context.framerate = _TICKS, Fraction(FRAMES_PER_SECOND)
        if self._codec is Codec.H264:
            context.profile = "Baseline"
            context.options = {
                "preset": "superfast",
                "tune": "zerolatency",
                "forced-idr": "1",
                "sc_threshold": "0",
                # without a bound libx264 ignores a new bitrate
                "maxrate": str(BITRATES[-1]),
                "bufsize": str(BITRATES[-1] // 2),
            }
        else:
            context.qmin, context.qmax = 2, 56
            context.options = {
                "deadline": "realtime",
                "cpu-used": str(-self._vp8_speed),
                "lag-in-frames": "0",
                "minrate": str(bitrate),
                "maxrate": str(bitrate),
                "bufsize": str(bitrate),
                "undershoot-pct": "100",
                "overshoot-pct": "15",
                "static-thresh": "1",
            }
        return context


def timed(packet: Packet, tick: int) -> Packet:
    """`packet`, shown at `tick` (1/30 s)."""
    packet.pts, packet.time_base = tick * _CLOCK_RATE // FRAMES_PER_SECOND, _TIME_BASE
    return packet


def _concatenated(packets: Many[Packet]) -> Packet:
    """Encoders without delay give one packet a frame; libvpx none where it dropped one."""
    return Packet(b"".join(bytes(packet) for packet in packets))


def negotiated_codec(sdp_offer: str) -> Codec:
    """The codec to answer an offer with: H.264 if it is offered as we send it, else VP8."""
    formats: dict[str, str] = {}
    h264 = set()
    for line in sdp_offer.splitlines():
        name, _, rest = line.strip().partition(":")
        number, _, text = rest.partition(" ")
        if name == "a=rtpmap" and text.lower().startswith("h264/90000"):
            h264.add(number)
        if name == "a=fmtp":
            formats[number] = text.replace(" ", "").lower()
    for number in h264:
        said = formats.get(number, "").split(";")
        if "packetization-mode=1" in said and any(
            part.startswith(("profile-level-id=42e0", "profile-level-id=42c0")) for part in said
        ):
            return Codec.H264
    return Codec.VP8
