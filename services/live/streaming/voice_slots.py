"""Who is heard in which slot: every listener has a few tracks, however many may talk.

Slots are the same for all listeners. Whoever's microphone is on holds one as long as there are
enough, so that no first syllable is lost; where more talk than there are slots, whoever has been
quiet longest gives way to a voice, and while all slots talk the next waits for a pause.
Levels are those of RFC 6464: 0 (loudest) to 127 (silence), -dBov, as the speaker's own device
measures them, so that nothing has to be decoded here.
"""

from __future__ import annotations

from dataclasses import dataclass

SLOTS = 6
_VOICE_DBOV = 50
"""A voice is louder than -50 dBov; a quiet room has -60 and less."""
_PAUSE_S = 0.6
"""Pauses between words don't end a speech."""
_DTX_BYTES = 2
"""Opus (RFC 6716, section 2.1.9) marks silence by packets of at most so many bytes."""


@dataclass(eq=False)
class _Speaker:
    slot: int
    voice_s: float
    """When their voice was heard last; before that, when they came."""
    spoke: bool = False


class VoiceSlots:
    """The slots of one meeting. Moments are seconds of any clock that only goes forward."""

    def __init__(self, count: int = SLOTS) -> None:
        self._count = count
        self._speakers: dict[str, _Speaker] = {}

    def assign(self, participant_id: str, now_s: float, *, voice: bool) -> int | None:
        """The slot that a packet of somebody goes to; None where there is none for them now."""
        speaker = self._speakers.get(participant_id)
        if speaker is None:
            slot = self._free(now_s, voice=voice)
            if slot is None:
                return None
            speaker = self._speakers[participant_id] = _Speaker(slot, now_s)
        if voice:
            speaker.voice_s, speaker.spoke = now_s, True
        return speaker.slot

    def release(self, participant_id: str) -> None:
        """Free the slot of somebody who may not speak, or has gone."""
        self._speakers.pop(participant_id, None)

    def holders(self) -> tuple[str | None, ...]:
        """The participant in each slot."""
        found: list[str | None] = [None] * self._count
        for participant_id, speaker in self._speakers.items():
            found[speaker.slot] = participant_id
        return tuple(found)

    def speaking(self, now_s: float) -> frozenset[str]:
        """Whose voice is heard now, pauses between words included."""
        return frozenset(
            who
            for who, speaker in self._speakers.items()
            if speaker.spoke and now_s - speaker.voice_s <= _PAUSE_S
        )

    def _free(self, now_s: float, *, voice: bool) -> int | None:
        taken = {speaker.slot for speaker in self._speakers.values()}
        if len(taken) < self._count:
            return min(set(range(self._count)) - taken)
        quietest = min(self._speakers, key=lambda who: self._speakers[who].voice_s)
        if not voice or now_s - self._speakers[quietest].voice_s <= _PAUSE_S:
            return None
        return self._speakers.pop(quietest).slot


def is_voice(level_dbov: int | None, payload_bytes: int) -> bool:
    """Whether an Opus packet holds a voice, by the level its sender measured.

    Where the sender tells none, whatever is not marked as silence counts.
    """
    if level_dbov is None:
        return payload_bytes > _DTX_BYTES
    return level_dbov < _VOICE_DBOV
