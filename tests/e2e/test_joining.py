"""`metanerf join`: a clip plays the part of a webcam in a meeting of a real server."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import numpy as np
import pytest
from aiortc.contrib.media import MediaPlayer
from prometheus_client import REGISTRY
from typer.testing import CliRunner

from services.bootstrap import DEMO_MODEL, import_model
from services.cli.app import app
from services.gateway import gateway_of
from services.live.look.picture import DroppedPictures, LookPicture, PoseRequest
from services.live.motion.live_motion import LiveMotion, SolvedPose
from services.live.room import MeetingPerformer
from services.meetings import create_meeting
from tests.e2e.serving import Gateway, serving
from tests.e2e.test_live_look import networks
from tests.servers import free_port
from tests.services.joining.test_whip_webcam import Sender
from tests.shared_data import shared_data

pytestmark = pytest.mark.e2e
CLIP = "real-monocular/webcam_upperbody_woman_asl.mp4"


class Kept(DroppedPictures):
    """The pictures that the server shows, each with what the landmarks of its moment came to."""

    def __init__(self) -> None:
        self.motions: list[LiveMotion] = []
        self.shown: list[tuple[LookPicture, SolvedPose | None]] = []

    def of(self, performer: MeetingPerformer, motion: LiveMotion) -> Kept:
        self.motions.append(motion)
        return self

    def receive(self, picture: LookPicture, request: PoseRequest | None = None) -> None:
        self.shown.append((picture, self.motions[-1].solved(picture.captured_ms)))


@pytest.fixture
def gateway(tmp_path: Path) -> Iterator[Gateway]:
    with serving(tmp_path / "data") as running:
        yield running


@pytest.fixture
def kept(gateway: Gateway) -> Kept:
    kept = Kept()
    gateway_of(gateway.app).views.driving_channels.make_look_sink = kept.of
    return kept


@pytest.fixture
def link(gateway: Gateway) -> str:
    """To a meeting with Ada, of the account `ada`."""
    services = gateway.services
    ada = import_model(services, DEMO_MODEL, "ada", "Ada")
    with services.unit_of_work() as unit:
        meeting = create_meeting(services, unit, "ada", "Monday", [ada])
        unit.commit()
    return f"{gateway.address}?meeting={meeting.id}"


def solved_packets() -> float:
    """How many landmarks became poses so far."""
    return REGISTRY.get_sample_value("metanerf_keypoints_total", {"outcome": "solved"}) or 0.0


def join(*words: str) -> tuple[int, str]:
    """Exit code and what was said."""
    found = networks()
    environment = {f"METANERF_{name.upper()}": str(path) for name, path in found.items()}
    done = CliRunner(env=environment).invoke(app, ["join", *words])
    return done.exit_code, done.output + str(done.exception or "")


def test_a_clip_moves_ones_model_and_colours_it(gateway: Gateway, kept: Kept, link: str):
    clip = shared_data(CLIP)
    own = ("--token", gateway.token("ada"))
    code, said = join(link, "--webcam", str(clip), "--live-look", *own)
    assert code == 0, said
    told = re.search(r"(\d+) frames looked at, (\d+) sent, (\d+) pictures", said)
    assert told, said
    looked, sent, pictures = map(int, told.groups())
    assert 8 < pictures <= sent <= looked
    # the first frames of VP8 come before the landmarks that announce them
    assert 0.5 * pictures < len(kept.shown) <= pictures
    for picture, solved in kept.shown:
        assert solved is not None, "of the very moment of the picture"
        assert picture.matte.mean() > 30.0
        assert picture.rgb[picture.matte == 0].mean() < 8.0
    poses = np.array([solved.pose.joint_angles for _, solved in kept.shown if solved])
    assert np.abs(np.ptp(poses, axis=0)).max() > 0.3, "hands go up to the mouth"
    assert not gateway_of(gateway.app).views.is_watched(link.partition("meeting=")[2])


def send_by_whip(clip: Path, url: str, seconds: float) -> int:
    """What a program does that sends a webcam's video; the status of the end."""

    async def send() -> int:
        player = MediaPlayer(str(clip), loop=True)
        assert player.video is not None
        sender = Sender(player.video)
        async with asyncio.timeout(60.0):
            while True:
                try:
                    await sender.begin(url)
                    break
                except httpx.ConnectError:
                    await asyncio.sleep(0.2)
        await asyncio.sleep(seconds)
        return await sender.end()

    return asyncio.run(send())


def test_a_programs_video_by_whip_does_the_same(gateway: Gateway, kept: Kept, link: str):
    clip, port = shared_data(CLIP), free_port()
    own = ("--token", gateway.token("ada"))
    with ThreadPoolExecutor(1) as aside:
        sent = aside.submit(send_by_whip, clip, f"http://127.0.0.1:{port}/whip", 15.0)
        code, said = join(link, "--whip", str(port), "--live-look", *own)
        assert sent.result() == 200
    assert code == 0, said
    told = re.search(r"(\d+) frames looked at, (\d+) sent, (\d+) pictures", said)
    assert told, said
    assert int(told[3]) > 8
    assert len(kept.shown) > 0.5 * int(told[3])
    for picture, solved in kept.shown:
        assert solved is not None, "of the very moment of the picture"
        assert picture.rgb[picture.matte == 0].mean() < 8.0, "the room stays here"


def test_without_live_look_no_picture_leaves(gateway: Gateway, kept: Kept, link: str):
    clip = shared_data(CLIP)
    before = solved_packets()
    code, said = join(link, "--webcam", str(clip), "--token", gateway.token("ada"))
    assert code == 0, said
    told = re.search(r"frames looked at, (\d+) sent\n", said)
    assert told, said
    assert solved_packets() - before > 0.7 * int(told[1])
    assert (kept.motions, kept.shown) == ([], [])


@pytest.mark.parametrize("live_look", [[], ["--live-look"]], ids=["motion", "live look"])
def test_nobody_elses_model_is_driven(gateway: Gateway, link: str, live_look: list[str]):
    clip = shared_data(CLIP)
    words = (link, "--webcam", str(clip), "--token", gateway.token("bob"), *live_look)
    code, said = join(*words)
    assert code == 1
    assert "the meeting must show a model" in said
    assert "got Ada" in said


@pytest.mark.parametrize(
    ("meeting", "webcam", "rule"),
    [
        ("monday", "clip.mp4", "the meeting must be the link"),
        ("http://127.0.0.1:1/?meeting=x", "none.mp4", "--webcam must be a video; got"),
        ("http://127.0.0.1:1/?meeting=x", "clip.mp4", "the meeting's server must answer"),
    ],
)
def test_mistakes_are_told(tmp_path: Path, meeting: str, webcam: str, rule: str):
    (tmp_path / "clip.mp4").write_bytes(b"no film")
    code, said = join(meeting, "--webcam", str(tmp_path / webcam))
    assert code == 1
    assert rule in said


@pytest.mark.parametrize(
    ("words", "got"), [((), "neither"), (("--webcam", "clip.mp4", "--whip", "8001"), "both")]
)
def test_one_webcam_is_asked_for(words: tuple[str, ...], got: str):
    code, said = join("http://127.0.0.1:1/?meeting=x", *words)
    assert code == 1
    assert f"one of --webcam FILE and --whip PORT must be given; got {got}" in said
