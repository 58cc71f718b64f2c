"""The process that decodes one recorded voice (services.confinement):

    python -m services.recording.confined_voice

Opus packets come by standard input, each behind its length in bytes. Their samples (16 bits, little
endian, mono, 48 kHz) go out; of a packet that cannot be decoded, 20 ms of silence.
"""

from __future__ import annotations

import struct
import sys

from services.confinement import Limits, confine

HEAD = struct.Struct("<H")
LIMITS = Limits(memory_bytes=512 << 20, processor_s=3600, file_bytes=0, open_files=64)
"""A day of somebody's voice takes a few minutes of the processor's time."""
_RATE = 48_000
_SPOILT = bytes(2 * 960)


def main() -> None:
    """Decode until the input ends."""
    confine(LIMITS)
    # not before this process is confined
    from av import CodecContext, Packet
    from av.audio.codeccontext import AudioCodecContext
    from av.error import FFmpegError

    decoder: AudioCodecContext = CodecContext.create("libopus", "r")
    decoder.format, decoder.layout, decoder.sample_rate = "s16", "mono", _RATE
    reading, out = sys.stdin.buffer, sys.stdout.buffer
    while len(head := reading.read(HEAD.size)) == HEAD.size:
        (length,) = HEAD.unpack(head)
        try:
            frames = decoder.decode(Packet(reading.read(length)))
        except FFmpegError:  # a packet that a speaker's device spoilt
            out.write(_SPOILT)
            continue
        for frame in frames:
            out.write(bytes(frame.planes[0])[: 2 * frame.samples])


if __name__ == "__main__":
    main()
