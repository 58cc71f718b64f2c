"""Everybody hears the others, nobody themselves, and only whose microphone is on."""

from __future__ import annotations

import numpy as np

from services.live.mixer import SAMPLE_RATE, SAMPLES, Mixer, Voice


def level(value: int, ticks: int = 1) -> np.ndarray:
    return np.full(SAMPLES * ticks, value, np.int16)


async def heard(voice: Voice) -> int:
    frame = await voice.recv()
    assert (frame.sample_rate, frame.samples) == (SAMPLE_RATE, SAMPLES)
    (samples,) = frame.to_ndarray()
    assert np.ptp(samples) == 0
    return int(samples[0])


def crowd(*names: str) -> tuple[Mixer, list[Voice], list[frozenset[str]]]:
    told: list[frozenset[str]] = []
    mixer = Mixer(told.append)
    voices = [Voice(name) for name in names]
    mixer.voices |= set(voices)
    mixer.may_speak = set(names)
    return mixer, voices, told


async def test_each_hears_the_sum_of_the_others():
    mixer, voices, _ = crowd("a", "b", "c")
    for voice, value in zip(voices, (100, 20, 3), strict=True):
        voice.say(level(value))
    mixer.mix()
    assert [await heard(voice) for voice in voices] == [23, 103, 120]
    mixer.mix()
    assert [await heard(voice) for voice in voices] == [0, 0, 0]


async def test_loud_together_is_clipped_not_wrapped():
    mixer, voices, _ = crowd("a", "b", "c")
    for voice in voices:
        voice.say(level(30_000))
    mixer.mix()
    assert await heard(voices[0]) == 32_767


async def test_a_microphone_that_is_off_is_not_heard_and_not_saved_up():
    mixer, (a, b), told = crowd("a", "b")
    mixer.may_speak = {"b"}
    a.say(level(9_000))
    mixer.mix()
    assert await heard(b) == 0
    mixer.may_speak = {"a", "b"}
    mixer.mix()
    assert await heard(b) == 0
    assert told == []


async def test_what_comes_late_or_is_not_fetched_is_dropped():
    mixer, (a, b), _ = crowd("a", "b")
    for value in range(20):
        a.say(level(value))
    for _ in range(9):
        mixer.mix()
    # a's newest 100 ms were kept; of what b was sent, the newest 100 ms too: one tick and silence
    assert [await heard(b) for _ in range(5)] == [19, 0, 0, 0, 0]


async def test_packets_of_any_length_become_ticks():
    mixer, (a, b), _ = crowd("a", "b")
    a.say(level(7)[: SAMPLES // 2])
    mixer.mix()
    assert await heard(b) == 0
    a.say(level(7)[: SAMPLES // 2])
    mixer.mix()
    assert await heard(b) == 7


async def test_who_speaks_is_told_once_and_pauses_do_not_count():
    mixer, (a, _), told = crowd("a", "b")
    for _ in range(3):
        a.say(level(2_000))
        mixer.mix()
    for _ in range(20):
        mixer.mix()
    a.say(level(2_000))
    mixer.mix()
    assert told == [frozenset({"a"})]
    for _ in range(31):
        mixer.mix()
    assert told == [frozenset({"a"}), frozenset()]
