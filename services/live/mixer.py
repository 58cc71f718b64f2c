"""Everybody in a meeting hears all others: the sum of their voices but for one's own.

48 kHz, mono, 16 bit, 20 ms at a time. A voice that comes late is dropped rather than queued.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from fractions import Fraction

import numpy as np
from aiortc import MediaStreamTrack
from av import AudioFrame

SAMPLE_RATE = 48_000
SAMPLES = 960
"""Of one tick: 20 ms, the length of an Opus packet."""
TICK_S = SAMPLES / SAMPLE_RATE
_MOST_WAITING = 5
"""Ticks that may wait, 100 ms: more would be heard as lag."""
_SPEAKING_LEVEL = 400.0
"""Root mean square of somebody who speaks, of 32,768; a quiet room has some tens."""
_SPEAKING_TICKS = 30
"""Pauses between words don't end a speech: 0.6 s."""
_SILENCE = np.zeros(SAMPLES, np.int16)


class Voice(MediaStreamTrack):
    """One person's part: what they say goes in by `say`, what they hear comes out as a track."""

    kind = "audio"

    def __init__(self, participant_id: str) -> None:
        super().__init__()
        self.participant_id = participant_id
        self.speaking_ticks = 0
        """Ticks for which they still count as speaking."""
        self._said: deque[np.ndarray] = deque(maxlen=_MOST_WAITING)
        self._rest = np.zeros(0, np.int16)
        self._heard: asyncio.Queue[np.ndarray] = asyncio.Queue(_MOST_WAITING)
        self._pts = 0

    def say(self, samples: np.ndarray) -> None:
        """Add int16 samples, of any number."""
        self._rest = np.concatenate([self._rest, samples])
        while len(self._rest) >= SAMPLES:
            self._said.append(self._rest[:SAMPLES])
            self._rest = self._rest[SAMPLES:]

    def take(self) -> np.ndarray | None:
        """What they say in this tick, if anything."""
        return self._said.popleft() if self._said else None

    def hear(self, samples: np.ndarray) -> None:
        """What the others say in this tick."""
        if self._heard.full():
            self._heard.get_nowait()
        self._heard.put_nowait(samples)

    async def recv(self) -> AudioFrame:
        """The next 20 ms of the others."""
        samples = await self._heard.get()
        frame = AudioFrame.from_ndarray(samples[None], format="s16", layout="mono")
        frame.sample_rate = SAMPLE_RATE
        frame.pts, frame.time_base = self._pts, Fraction(1, SAMPLE_RATE)
        self._pts += SAMPLES
        return frame


class Mixer:
    """The voices of one meeting."""

    def __init__(self, on_speaking: Callable[[frozenset[str]], None]) -> None:
        self.voices: set[Voice] = set()
        self.may_speak: set[str] = set()
        """Participants whose microphone is on; what others send is not heard."""
        self._on_speaking = on_speaking
        self._speaking: frozenset[str] = frozenset()

    async def run(self) -> None:
        """Mix a tick every 20 ms."""
        loop = asyncio.get_running_loop()
        due_s = loop.time()
        while True:
            self.mix()
            # ticks that a busy machine missed are gone
            due_s = max(due_s + TICK_S, loop.time() - TICK_S)
            await asyncio.sleep(max(0.0, due_s - loop.time()))

    def mix(self) -> None:
        """One tick: take what each says, give each the sum of the others."""
        said: dict[Voice, np.ndarray] = {}
        for voice in self.voices:
            samples = voice.take()
            if samples is not None and voice.participant_id in self.may_speak:
                said[voice] = samples
            loud = voice in said and _level(said[voice]) > _SPEAKING_LEVEL
            voice.speaking_ticks = _SPEAKING_TICKS if loud else max(0, voice.speaking_ticks - 1)
        total = np.sum([*said.values(), _SILENCE], axis=0, dtype=np.int32)
        for voice in self.voices:
            others = total - said[voice] if voice in said else total
            voice.hear(np.clip(others, -32_768, 32_767).astype(np.int16))
        speaking = frozenset(v.participant_id for v in self.voices if v.speaking_ticks > 0)
        if speaking != self._speaking:
            self._speaking = speaking
            self._on_speaking(speaking)


def _level(samples: np.ndarray) -> float:
    return float(np.sqrt(np.mean(samples.astype(np.float32) ** 2)))
