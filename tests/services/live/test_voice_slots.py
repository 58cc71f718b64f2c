"""Few tracks, many speakers: whoever talks is heard, and who was quiet longest gives way."""

from __future__ import annotations

import pytest

from services.live.streaming.voice_slots import VoiceSlots, is_voice


def test_each_keeps_a_slot_while_there_are_enough():
    slots = VoiceSlots(3)
    assert [slots.assign(who, 0.0, voice=False) for who in "abc"] == [0, 1, 2]
    assert slots.assign("b", 9.0, voice=True) == 1
    assert slots.holders() == ("a", "b", "c")
    slots.release("a")
    assert slots.holders() == (None, "b", "c")
    assert slots.assign("d", 9.0, voice=False) == 0


def test_a_voice_takes_the_slot_of_whoever_was_quiet_longest():
    slots = VoiceSlots(2)
    slots.assign("a", 0.0, voice=True)
    slots.assign("b", 0.5, voice=True)
    # a quiet microphone displaces nobody
    assert slots.assign("c", 5.0, voice=False) is None
    assert slots.assign("c", 5.0, voice=True) == 0
    assert slots.holders() == ("c", "b")


def test_while_all_talk_the_next_waits_for_a_pause():
    slots = VoiceSlots(2)
    slots.assign("a", 1.0, voice=True)
    slots.assign("b", 1.1, voice=True)
    assert slots.assign("c", 1.2, voice=True) is None
    slots.assign("b", 1.65, voice=True)
    assert slots.assign("c", 1.7, voice=True) == 0


def test_pauses_between_words_do_not_end_a_speech():
    slots = VoiceSlots()
    slots.assign("a", 0.0, voice=False)
    assert slots.speaking(0.0) == frozenset()
    slots.assign("a", 1.0, voice=True)
    assert slots.speaking(1.5) == {"a"}
    assert slots.speaking(1.7) == frozenset()


@pytest.mark.parametrize(
    ("level", "size", "voice"),
    [
        (20, 90, True),
        (49, 90, True),
        (70, 90, False),
        (127, 3, False),
        (None, 60, True),
        (None, 1, False),
    ],
)
def test_the_senders_own_measure_tells_a_voice(level, size, voice):
    assert is_voice(level, size) is voice
