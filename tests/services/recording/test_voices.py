"""Recorded voices are summed in time, and a hostile one takes nothing along but its decoder."""

from __future__ import annotations

import logging
import random
from pathlib import Path

import numpy as np
import pytest

from services.recording import voices
from services.recording.chunks import Record
from services.recording.voices import mix
from tests.services.attempts import nothing_is_reached
from tests.services.recording.test_chunks import RATE, voice
from tests.services.uploads.test_apart import NO_LANDLOCK, has_landlock


def said(seconds: float) -> dict[str, list[Record]]:
    """Somebody's voice from the start."""
    return {"a": [Record(20 * at, data) for at, data in enumerate(voice(seconds))]}


def test_voices_are_summed_in_time_and_a_spoilt_packet_is_silence():
    one = [Record(20 * at, data) for at, data in enumerate(voice(0.4, 300.0))]
    other = [Record(1000 + 20 * at, data) for at, data in enumerate(voice(0.4, 800.0))]
    spoilt = [Record(0, b"\xff" * 5)]
    total = mix({"a": one, "b": other, "c": spoilt}, 1.5)
    assert len(total) == int(1.5 * RATE)

    def loudest(start_s: float) -> float:
        piece = total[int(start_s * RATE) : int((start_s + 0.2) * RATE)]
        spectrum = np.abs(np.fft.rfft(piece * np.hanning(len(piece))))
        return float(np.fft.rfftfreq(len(piece), 1 / RATE)[spectrum.argmax()])

    assert abs(loudest(0.1) - 300.0) < 10.0
    assert abs(loudest(1.1) - 800.0) < 10.0
    assert np.abs(total[int(0.6 * RATE) : int(0.9 * RATE)]).max() < 0.01


def test_what_was_said_after_the_end_of_a_recording_is_left_out():
    assert len(mix(said(1.0), 0.3)) == int(0.3 * RATE)
    assert not mix({"a": []}, 0.3).any()


@pytest.mark.parametrize(
    ("script", "told"),
    [
        ("head -c 4 /dev/zero; kill -SEGV $$", "SIGSEGV"),
        ("echo 'MemoryError' >&2; exit 1", "MemoryError"),
        ("exec sleep 30", "no end after 0.5 s"),
    ],
)
def test_a_crash_costs_the_rest_of_that_voice_alone(
    instead, monkeypatch: pytest.MonkeyPatch, caplog, script: str, told: str
):
    monkeypatch.setattr(voices, "PIECE_S", 0.5)
    instead(script)
    with caplog.at_level(logging.WARNING):
        total = mix(said(0.2), 0.5)
    # nor is anything of it decoded here
    assert not total.any()
    assert "a recorded voice ends after 0.0 s, its decoder: " in caplog.text
    assert told in caplog.text


def test_one_that_is_killed_fails_so_that_no_voice_is_missing_for_want_of_memory(instead):
    instead("kill -KILL $$")
    with pytest.raises(MemoryError, match="killed; try again"):
        mix(said(0.2), 0.5)


def test_packets_of_anything_are_sound_or_silence_and_harm_no_other_voice():
    chance, whole = random.Random(7), voice(0.4)
    spoilt = []
    for number in range(300):
        packet = bytearray(whole[number % len(whole)])
        for _ in range(chance.randrange(1, 9)):
            packet[chance.randrange(len(packet))] = chance.randrange(256)
        spoilt.append(Record(20 * number, bytes(packet[: chance.randrange(len(packet) + 1)])))
    total = mix({"b": spoilt}, 9.0)
    assert np.isfinite(total).all()
    both = mix(
        {"b": spoilt, "c": [Record(8000 + 20 * at, one) for at, one in enumerate(whole)]}, 9.0
    )
    assert np.abs(both - total)[8 * RATE :].max() > 0.1


def test_whatever_it_prints_is_bounded_by_the_recording(instead):
    instead("exec cat /dev/zero")
    assert len(mix(said(0.2), 0.5)) == int(0.5 * RATE)


def test_no_secret_is_told(instead, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("METANERF_JWT_SECRET", "of the server")
    instead(f"env > {tmp_path / 'told'}")
    mix(said(0.2), 0.5)
    told = (tmp_path / "told").read_text()
    assert "PATH=" in told
    assert "of the server" not in told


@pytest.mark.skipif(not has_landlock(), reason=NO_LANDLOCK)
def test_what_decodes_has_no_files_and_no_network(tmp_path: Path):
    nothing_is_reached("services.recording.confined_voice", tmp_path)
