"""Sealed meetings over real WebRTC: motion passes unread; what would have to read it is refused."""

from __future__ import annotations

import asyncio
import json
from functools import cache
from typing import Any

import pytest
from aiortc import RTCConfiguration, RTCDataChannel, RTCPeerConnection, RTCSessionDescription
from cryptography.exceptions import InvalidTag
from fastapi import FastAPI

from db.models import ModelRow
from services.bootstrap import DEMO_MODEL
from services.container import Services
from services.gateway import gateway_of
from services.live.motion.body_packet import encode_body
from services.live.motion.motion_packet import MOTION_BYTES
from services.live.packets import (
    BATCHES,
    LONGEST_BATCH,
    PacketError,
    ViewPacket,
    encode_view,
    performer_check,
)
from services.live.room import MeetingPerformer, Room, facing_yaw
from services.live.sealed_packet import SEALED_BYTES, require_sealed, take_batches
from services.live.streaming.pose_feed import POSES_PER_SECOND
from services.meetings import create_meeting
from services.person_models import VIEWER_FILE
from tests.renderer.studio import make_model, make_motion
from tests.services import seeds
from tests.services.live.test_driving_channels import consent, motions, outcome, until
from tests.services.live.viewer import Viewer
from tools.build_sealed_cases import SEALED_CASES, cases, seal, unseal

KEY, SALT = bytes(range(16)), bytes(range(100, 116))
_NEWEST = {"ordered": False, "maxRetransmits": 0}
_DRAWS = ViewPacket(1, 0.0, (0.0, 1.0, 3.0), (0.0, 1.0, 0.0, 0.0), 0.7, 128, 128, draws_itself=True)


class SealedPage:
    """A page in a sealed meeting: data channels alone, and what came over them."""

    def __init__(self) -> None:
        self.peer = RTCPeerConnection(RTCConfiguration(iceServers=[]))
        self.view = self.peer.createDataChannel("view", **_NEWEST)
        self.pose = self.peer.createDataChannel("pose", protocol=BATCHES, **_NEWEST)
        self.came: list[bytes] = []
        self.pose.on("message", self.came.append)

    def drives(self, performer_id: str, label: str = "motion") -> tuple[RTCDataChannel, list[Any]]:
        """A channel for a performer's motion, and what is said on it."""
        channel = self.peer.createDataChannel(label, protocol=performer_id, **_NEWEST)
        told: list[Any] = []
        channel.on("message", told.append)
        return channel, told

    async def offer(self) -> str:
        await self.peer.setLocalDescription(await self.peer.createOffer())
        return self.peer.localDescription.sdp

    async def connect(self, app: FastAPI, meeting_id: str, account: str) -> None:
        """Join, and say that this page draws by itself."""
        views = gateway_of(app).views
        _, answer = await views.open(meeting_id, await self.offer(), None, account)
        await self.peer.setRemoteDescription(RTCSessionDescription(answer, "answer"))
        await until(lambda: self.view.readyState == "open", "opening the channel")
        self.view.send(encode_view(_DRAWS))

    def packets(self) -> list[tuple[int, bytes]]:
        """Whose sealed packets came, by their place, and each packet."""
        found = []
        for message in self.came:
            assert message[:2] == b"\x01\x0b"
            for at in range(2, len(message), 4 + SEALED_BYTES):
                found.append((message[at], message[at + 4 : at + 4 + SEALED_BYTES]))
        return found


@pytest.fixture
def ada(services: Services) -> ModelRow:
    return seeds.imported(services, DEMO_MODEL, "house", "Ada")


@pytest.fixture
def meeting_id(services: Services, ada: ModelRow) -> str:
    """A sealed meeting of Ada, of account `house`, and Bo, of `elsewhere`."""
    bo = seeds.imported(services, DEMO_MODEL, "elsewhere", "Bo")
    with services.unit_of_work() as unit:
        meeting = create_meeting(services, unit, "house", "Monday", [ada, bo], sealed=True)
        unit.commit()
    return meeting.id


@pytest.fixture
async def room(app: FastAPI, meeting_id: str) -> Room:
    return await gateway_of(app).views.room(meeting_id)


@cache
def waves() -> list[bytes]:
    """The motion of somebody who waves, which takes a while to solve."""
    return motions()


def sealed(performer_id: str, meeting_id: str, counter: int) -> bytes:
    """What their page sends of it."""
    return seal(KEY, SALT, counter, waves()[counter], meeting_id, performer_id)


async def test_sealed_motion_passes_unread_to_whoever_draws(app, room, meeting_id):
    who = room.performers[0]
    wanted = [sealed(who.performer_id, meeting_id, n) for n in range(12)]
    sender, viewer = SealedPage(), SealedPage()
    channel, told = sender.drives(who.performer_id)
    await sender.connect(app, meeting_id, "house")
    await viewer.connect(app, meeting_id, "elsewhere")
    await until(lambda: channel.readyState == "open", "opening the channel")
    channel.send("whose?")
    await until(lambda: told != [], "telling the body")
    assert told == [encode_body(who.model.skeleton, -facing_yaw(who.motion))]
    before = outcome("sealed")
    for packet in wanted:
        channel.send(packet)
        await asyncio.sleep(1.5 / POSES_PER_SECOND)
    await until(lambda: len(viewer.packets()) >= 8, "passing motion on")
    await until(lambda: outcome("sealed") == before + 12, "counting it")
    for index, packet in viewer.packets():
        assert (index, packet in wanted) == (0, True)
    opened = [unseal(KEY, one, meeting_id, who.performer_id) for _, one in viewer.packets()]
    assert set(opened) <= set(waves()[:12])
    # nobody is followed here, and the clip's own motion is sent to nobody
    assert room.live_motions == {}
    await sender.peer.close()
    await until(lambda: room.sealed_motions == {}, "letting go")
    await viewer.peer.close()


async def test_what_is_not_sealed_goes_nowhere(app, room, meeting_id):
    who = room.performers[0].performer_id
    good = sealed(who, meeting_id, 1)
    sender, viewer = SealedPage(), SealedPage()
    channel, _ = sender.drives(who)
    await sender.connect(app, meeting_id, "house")
    await viewer.connect(app, meeting_id, "elsewhere")
    await until(lambda: channel.readyState == "open", "opening the channel")
    before = outcome("malformed")
    refused = [
        waves()[0],
        good[:-1],
        good + b"0",
        b"\x02" + good[1:],
        good[:2] + b"\x01" + good[3:],
    ]
    for packet in [*refused, b""]:
        channel.send(packet)
    await until(lambda: outcome("malformed") == before + 6, "counting nonsense")
    channel.send(good)
    await until(lambda: len(viewer.packets()) == 1, "passing the good one on")
    assert viewer.packets() == [(0, good)]
    flood = outcome("flood")
    for _ in range(400):
        channel.send(good)
    await until(lambda: outcome("flood") > flood + 100, "dropping a flood")
    for one in (sender, viewer):
        await one.peer.close()


@pytest.mark.parametrize(
    ("label", "account", "status", "words"),
    [
        ("keypoints", "house", 409, "must solve poses itself and seal them"),
        ("motion", "elsewhere", 403, "of the account whose person is driven"),
    ],
)
async def test_landmarks_and_other_peoples_motion_are_refused(
    app, room, meeting_id, label, account, status, words
):
    page = SealedPage()
    channel, told = page.drives(room.performers[0].performer_id, label)
    await page.connect(app, meeting_id, account)
    await until(lambda: channel.readyState == "closed", "closing the channel")
    problem = json.loads(told[0])
    assert problem["status"] == status
    assert words in problem["detail"]
    await page.peer.close()


async def test_who_is_shown_no_longer_is_passed_on_no_longer(app, room, meeting_id, services):
    page = SealedPage()
    channel, told = page.drives(room.performers[0].performer_id)
    await page.connect(app, meeting_id, "house")
    await until(lambda: channel.readyState == "open", "opening the channel")
    consent(services, "Ada")
    await gateway_of(app).views.refresh(meeting_id)
    await until(lambda: channel.readyState == "closed", "closing the channel")
    assert "their consent has ended" in json.loads(told[0])["detail"]
    await page.peer.close()


async def test_the_server_says_that_it_draws_no_sealed_meeting(caller, services, meeting_id):
    seat = (await caller.post(f"/v1/meetings/{meeting_id}/join", json={})).json()
    header = {"Authorization": f"Bearer {seat['token']}"}
    viewer = Viewer()
    answer = await viewer.look(caller, meeting_id, header)
    assert answer.status_code == 409
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.json()["type"] == "urn:metanerf:meeting-sealed"
    assert "must be of data channels alone; got one of pictures" in answer.json()["detail"]
    page = SealedPage()
    offer = {"content": await page.offer(), "headers": header | {"Content-Type": "application/sdp"}}
    assert (await caller.post(f"/whep/{meeting_id}", **offer)).status_code == 201
    for one in (viewer, page):
        await one.peer.close()


async def test_only_whom_pages_draw_and_move_may_stand_in_it(caller, services, ada: ModelRow):
    field = seeds.imported(services, DEMO_MODEL, "house", "Cy")
    with services.unit_of_work() as unit:  # as of a field, which pages have no file of
        row = unit.models.get(field.id)
        row.files = [one for one in row.files if one.name != VIEWER_FILE]
        unit.commit()
    body = {"name": "Monday", "model_ids": [field.id], "sealed": True}
    answer = await caller.post("/v1/meetings", json=body)
    assert (answer.status_code, answer.json()["type"]) == (409, "urn:metanerf:meeting-sealed")
    assert "must have a model of splats" in answer.json()["detail"]
    opened = (await caller.post("/v1/meetings", json={"name": "Monday", "sealed": True})).json()
    assert opened["sealed"] is True
    file = {"file": ("wave.json", json.dumps(seeds.keypoints(30, angle=0.8)))}
    stored = await caller.post(f"/v1/people/{ada.person_id}/sequences", files=file)
    place = f"/v1/meetings/{opened['id']}/performers"
    moved = {"model_id": ada.id, "motion_sequence_id": stored.json()["id"]}
    answer = await caller.post(place, json=moved)
    assert (answer.status_code, answer.json()["type"]) == (409, "urn:metanerf:meeting-sealed")
    assert "must move by their own page" in answer.json()["detail"]
    assert (await caller.post(place, json={"model_id": ada.id})).status_code == 201
    usual = (await caller.post("/v1/meetings", json={"name": "Monday"})).json()
    assert usual["sealed"] is False


def test_everybodys_packets_fit_into_messages_of_the_network():
    model = make_model(20)
    members = [
        MeetingPerformer(str(n), f"P{n}", model, make_motion(3), (0.0, 0.0, 0.0), 0.0)
        for n in range(12)
    ]
    room = Room("m", tuple(members), sealed=True)
    assert take_batches(room) == []
    room.sealed_motions |= {str(n): seal(KEY, SALT, n, waves()[n], "m", str(n)) for n in range(8)}
    batches = take_batches(room)
    assert [len(one) <= LONGEST_BATCH for one in batches] == 3 * [True]
    records = [
        one[at : at + 4 + SEALED_BYTES]
        for one in batches
        for at in range(2, len(one), 4 + SEALED_BYTES)
    ]
    for n, record in enumerate(records):
        assert record[:2] == bytes([n, 12])
        assert int.from_bytes(record[2:4], "little") == performer_check(str(n))
        assert unseal(KEY, record[4:], "m", str(n)) == waves()[n]
    # each is passed on once
    assert (len(records), take_batches(room)) == (8, [])


def test_the_pages_cases_are_those_that_this_library_makes():
    stored, made = json.loads(SEALED_CASES.read_text()), cases()
    told = ("key", "meeting", "performer", "salt", "code", "packets")
    assert {name: stored[name] for name in told} == {name: made[name] for name in told}
    for case in stored["packets"]:
        packet = bytes.fromhex(case["sealed"])
        require_sealed(packet)
        with pytest.raises(InvalidTag):
            unseal(bytes(16), packet, stored["meeting"], stored["performer"])


def test_what_cannot_be_sealed_motion_is_named():
    assert SEALED_BYTES == 8 + 16 + MOTION_BYTES + 16
    good = seal(KEY, SALT, 1, waves()[1], "m", "p")
    for packet, words in [
        (good[:-1], f"must be {SEALED_BYTES} bytes long; got {SEALED_BYTES - 1}"),
        (b"\x01\x08" + good[2:], "version 1, kind 10, then zero; got 1, 8, 0"),
    ]:
        with pytest.raises(PacketError, match=words):
            require_sealed(packet)
