"""A voice and lips that move at one moment: when they are heard and seen, on a page and recorded.

A real service, WebRTC and Opus; a headless Chromium that looks on, at the server's pictures and at
its own, then at the recording, which is exported as a video as well. Landmarks leave at once, and
once more as late as a page on two cores finds them. What is heard is taken where the page hands
sound to the browser's output, by the times that the browser tells of it.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import av
import cv2
import httpx
import numpy as np
from playwright.sync_api import Page

from benchmarks.browser import metric, open_page, running_demo
from benchmarks.lipsync.offsets import Shown, Sound, lateness
from benchmarks.lipsync.talker import AUDIO_HZ, TalkingPerson
from benchmarks.lipsync.witness import SIDE_PX, Box, listen, watch, witnessed
from benchmarks.meeting import TO_POSE, OpenMeeting, have_the_page_draw, look, prepare_meeting
from benchmarks.reporting.figures import FigureWriter
from services.recording.replay import LoadedRecording, load
from services.recording.video_export import CameraKeyframe, CameraPath, export_video

PICTURE_PX = 512
FOUND_AFTER_MS = (0, 72)
"""Landmarks leave at once; or once a page on two cores has found body and face
(`landmark_finder` of `metanerf bench meeting`: 35 and 37 ms)."""
MUST_MS, AIM_MS = 80, 40
_WITNESSED_S = 25.0
_SETTLING_MS = 4000
_RECORDED_S = 16.0
_SENT_S = 15.0
_POSES = 30
"""Once so many were solved, somebody moves: what is compiled is compiled."""
_AT_WORST_S = 120.0
_HEAD: Box = (0.44, 0.33, 0.12, 0.09)
"""Where a picture that is taken from the front shows the lower half of the face."""
_BEFORE_HEAD = (0.0, 1.28, 2.2), (0.0, 1.28, 0.0)
"""Position and target of the camera that films the recording, m."""
_BLOCK = 128
_LOCAL = ".viewport > canvas.shown"
_SERVER = "[data-testid=live-video]"
_REPLAY = "[data-testid=replay]"


@dataclass(frozen=True)
class Talk(OpenMeeting):
    """A meeting in which one person talks."""

    folder: Path
    token: str
    person: TalkingPerson


def run(writer: FigureWriter) -> None:
    """Measure and report."""
    rows = [row for found_ms in FOUND_AFTER_MS for row in _rows(found_ms)]
    about = {"must_ms": MUST_MS, "aim_ms": AIM_MS, "size": PICTURE_PX}
    writer.write({**about, "landmarks_mbit_s": _sent_mbit_s(), "rows": rows})


def _sent_mbit_s() -> float:
    """What body, face and hands of somebody who is seen take on the wire, Mbit/s."""
    with talk_in_a_meeting(0.0) as talk:
        time.sleep(_SENT_S)
        before, started_s = talk.person.sent_bits(), time.perf_counter()
        time.sleep(_SENT_S)
        passed_s = time.perf_counter() - started_s
        sent = round(1e-6 * (talk.person.sent_bits() - before) / passed_s, 4)
    print({"landmarks_mbit_s": sent}, flush=True)
    return sent


def _rows(found_after_ms: int) -> Iterator[dict[str, Any]]:
    with talk_in_a_meeting(1e-3 * found_after_ms) as talk:
        with open_page(PICTURE_PX, PICTURE_PX, any_script=True) as page:
            listen(page)
            look(page, talk, PICTURE_PX, stamped=False)
            yield _row("server", found_after_ms, talk, _on_page(page, _SERVER))
            have_the_page_draw(page)
            yield _row("page", found_after_ms, talk, _on_page(page, _LOCAL))
        recording = recorded(talk)
        with open_page(PICTURE_PX, PICTURE_PX, any_script=True) as page:
            yield _row("replay", found_after_ms, None, _replayed(page, talk, recording))
        yield _row("video", found_after_ms, None, exported(talk, recording))


@contextmanager
def talk_in_a_meeting(found_after_s: float) -> Iterator[Talk]:
    """A service with a meeting in which one person talks."""
    with tempfile.TemporaryDirectory() as folder:
        meeting_id, token, (performer,) = prepare_meeting(Path(folder), 1)
        with running_demo(Path(folder)) as address:
            person = TalkingPerson(
                address, meeting_id, token, performer, found_after_s=found_after_s
            )
            with person.talking():
                _wait(lambda: metric(address, f"{TO_POSE}_count") > _POSES, _AT_WORST_S)
                yield Talk(address, meeting_id, Path(folder), token, person)


def _row(way: str, found_after_ms: int, talk: Talk | None, was: tuple[Sound, Shown]) -> dict:
    first_opening_s = None if talk is None else talk.person.first_opening_s
    load = round(os.getloadavg()[0], 1)
    row = {"seen_in": way, "found_after_ms": found_after_ms, "load": load}
    row |= lateness(*was, first_opening_s)
    print(row, flush=True)
    return row


def _on_page(page: Page, selector: str) -> tuple[Sound, Shown]:
    watch(page, selector, _HEAD)
    page.wait_for_timeout(_SETTLING_MS)
    return witnessed(page, _WITNESSED_S)


def recorded(talk: Talk, seconds: float = _RECORDED_S) -> str:
    """Id of a recording that the talker makes, alone."""
    talk.person.say(type="record", on=True)
    header = {"Authorization": f"Bearer {talk.token}"}
    with httpx.Client(base_url=talk.address, headers=header, timeout=30.0) as caller:

        def recordings() -> list[dict[str, Any]]:
            return caller.get("/v1/recordings").raise_for_status().json()["items"]

        _wait(lambda: any(one["duration_s"] > seconds for one in recordings()), _AT_WORST_S)
        talk.person.say(type="record", on=False)
        return recordings()[0]["id"]


def _wait(done: Callable[[], bool], most_s: float) -> None:
    due_s = time.monotonic() + most_s
    while not done():
        if time.monotonic() > due_s:
            raise RuntimeError(f"a service must serve one person within {most_s} s; got none")
        time.sleep(0.5)


def _replayed(page: Page, talk: Talk, recording: str) -> tuple[Sound, Shown]:
    listen(page)
    page.add_init_script(f"sessionStorage.setItem('metanerf.token', '{talk.token}')")
    page.goto(f"{talk.address}?recording={recording}")
    page.wait_for_function(
        f"() => Number(document.querySelector('{_REPLAY}')?.dataset.frames ?? 0) > 0"
    )
    watch(page, _REPLAY, _HEAD)
    page.get_by_test_id("replay-play").click()
    return witnessed(page, _RECORDED_S - 1.0)


def loaded(talk: Talk, recording: str) -> LoadedRecording:
    """A recording as an export needs it."""
    from services.composition import build_services
    from services.settings import load_settings

    services = build_services(load_settings(data_dir=talk.folder))
    try:
        return load(services, recording)
    finally:
        services.close()


def exported(talk: Talk, recording: str) -> tuple[Sound, Shown]:
    """What the exported video holds, by its own times."""
    out, keyframe = talk.folder / "video.mp4", CameraKeyframe(0.0, *_BEFORE_HEAD)
    path = CameraPath([keyframe], PICTURE_PX, PICTURE_PX, np.radians(35.0))
    export_video(loaded(talk, recording), path, out, lambda _: None)
    return video_contents(out)


def video_contents(file: Path) -> tuple[Sound, Shown]:
    """Sound and pictures of a video, by its own times."""
    times, peaks, shown, pictures = [], [], [], []
    with av.open(str(file)) as container:
        for frame in container.decode(container.streams.video[0], container.streams.audio[0]):
            if isinstance(frame, av.AudioFrame):
                samples = np.abs(frame.to_ndarray()).max(axis=0)
                blocks = samples[: len(samples) // _BLOCK * _BLOCK].reshape(-1, _BLOCK)
                times += [(frame.time or 0.0) + at * _BLOCK / AUDIO_HZ for at in range(len(blocks))]
                peaks += blocks.max(axis=1).tolist()
            elif isinstance(frame, av.VideoFrame):
                grey = frame.to_ndarray(format="gray")
                sides = (frame.width, frame.height) * 2
                left, top, width, height = (
                    round(side * share) for side, share in zip(sides, _HEAD, strict=True)
                )
                head = grey[top : top + height, left : left + width]
                shown.append(frame.time)
                pictures.append(cv2.resize(head, (SIDE_PX, SIDE_PX), interpolation=cv2.INTER_AREA))
    sound = Sound(np.array(times), np.array(peaks))
    return sound, Shown(np.array(shown), np.array(pictures, np.float32))
