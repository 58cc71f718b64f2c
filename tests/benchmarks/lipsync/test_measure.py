"""A voice and lips through a real service: what it keeps of both belongs together."""

from __future__ import annotations

import av
import numpy as np
import pytest

from benchmarks.lipsync.measure import loaded, recorded, talk_in_a_meeting, video_contents
from benchmarks.lipsync.offsets import Shown, Sound, clicks_heard, lateness
from benchmarks.lipsync.talker import PERIOD_S, sound
from scene.environment import Environment
from scene.expression import EXPRESSION_NAMES
from services.recording.chunks import Record
from services.recording.replay import LoadedRecording
from services.recording.video_export import AUDIO_RATE, CameraPath, export_video
from services.recording.voices import mix

BLOCK = 96


def test_what_a_recording_keeps_of_voice_and_jaw_belongs_together():
    with talk_in_a_meeting(0.0) as talk:
        recording = loaded(talk, recorded(talk, 4.0))
    samples = np.abs(mix(recording.voices, recording.duration_s))
    peaks = samples[: len(samples) // BLOCK * BLOCK].reshape(-1, BLOCK).max(axis=1)
    ((moments_ms, poses),) = recording.motions.values()
    jaw = np.array([pose.expression[EXPRESSION_NAMES.index("jaw_open")] for pose in poses])
    was = Shown(1e-3 * np.array(moments_ms), jaw[:, None, None])
    figures = lateness(Sound(np.arange(len(peaks)) * BLOCK / AUDIO_RATE, peaks), was)
    assert figures["openings"] >= 2
    # by the times that are kept, however busy the machine was: not a second, and not another word
    assert abs(figures["lips_after_voice_p50_ms"]) < 200


def test_an_exported_video_has_its_sound_in_time(tmp_path):
    encoder = av.CodecContext.create("libopus", "w")
    encoder.format, encoder.layout, encoder.sample_rate = "s16", "mono", AUDIO_RATE
    packets: list[bytes] = []
    for first in range(-9600, 3 * AUDIO_RATE, 960):
        frame = av.AudioFrame.from_ndarray(sound(first, 960).astype(np.int16)[None], "s16", "mono")
        frame.sample_rate, frame.pts = AUDIO_RATE, first + 9600
        packets += [bytes(packet) for packet in encoder.encode(frame)]
    said = [Record(400 + 20 * number, data) for number, data in enumerate(packets)]
    recording = LoadedRecording(4.0, [], {}, {"somebody": said}, {}, Environment(), frozenset())
    out = tmp_path / "video.mp4"
    export_video(recording, CameraPath((), 64, 64, 0.6), out, lambda _: None)
    played, shown = video_contents(out)
    assert len(shown.times_s) == 120
    # Opus begins 6.5 ms late; blocks last 2.7 ms
    expected = 0.6 + PERIOD_S * np.arange(3)
    assert clicks_heard(played) == pytest.approx(expected, abs=0.012)
