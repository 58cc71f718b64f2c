"""Recorded voices as sound, each decoded in a process of its own (`confined_voice`).

A decoder is C code, and a packet is whatever its speaker sent: one that takes the process over
reaches no secrets, no network and no files. A crash costs the rest of that voice alone, so that
nobody keeps others from their video.
"""

from __future__ import annotations

import logging
import signal

import numpy as np

from scene.arrays import Array, Float
from services.confinement import ConfinedProcess
from services.recording.chunks import Record
from services.recording.confined_voice import HEAD
from services.recording.ogg import OPUS_RATE, with_silence

log = logging.getLogger(__name__)

_PIECE_BYTES = 1 << 20
"""Ten seconds of sound."""
PIECE_S = 60.0
"""Until they are there, on a machine that does much else."""
_FULL = 32768.0


def mix(voices: dict[str, list[Record]], duration_s: float) -> Float[Array, "S"]:
    """Everybody's voice from the start, 48 kHz, -1 to 1.

    Raises MemoryError where a process that decodes was killed, as happens when memory runs out.
    """
    total: Float[Array, "S"] = np.zeros(int(duration_s * OPUS_RATE), np.float32)
    for said in voices.values():
        if said:
            _add(total, said)
    return np.clip(total, -1.0, 1.0, out=total)


def _add(total: Float[Array, "S"], said: list[Record]) -> None:
    packets = b"".join(HEAD.pack(len(one)) + one for one in with_silence(said))
    at = 0
    with ConfinedProcess("services.recording.confined_voice") as process:
        process.feed(packets)
        try:
            while left := 2 * (len(total) - at):
                piece = process.take(min(_PIECE_BYTES, left), PIECE_S)
                if len(piece) < 2:
                    break
                samples = np.frombuffer(piece[: len(piece) & ~1], "<i2")
                total[at : at + len(samples)] += samples / np.float32(_FULL)
                at += len(samples)
            else:  # what comes after the end of the recording is not waited for
                return
            code = process.wait(PIECE_S)
        except TimeoutError as error:
            code, how = None, str(error)
        else:
            how = process.how_ended()
    if code == -signal.SIGKILL:
        raise MemoryError("a voice must be decoded; got a process that was killed; try again")
    if code != 0:
        log.warning("a recorded voice ends after %.1f s, its decoder: %s", at / OPUS_RATE, how)
