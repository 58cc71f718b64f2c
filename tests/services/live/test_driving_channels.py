"""Motion over a real WebRTC connection: whose performer moves, and what is dropped."""

from __future__ import annotations

import asyncio
import json
import struct
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from aiortc import RTCDataChannel
from fastapi import FastAPI
from prometheus_client import REGISTRY

from db.models import Purpose
from services.container import Services
from services.gateway import gateway_of
from services.likeness import give_consent
from services.live.keypoints_packet import KeypointsPacket, encode_keypoints
from services.live.motion.body_packet import encode_body
from services.live.motion.live_motion import LiveMotion
from services.live.motion.motion_packet import MotionPacket, decode_motion, encode_motion
from services.live.motion.motion_solver import MotionSolver
from services.live.motion.receivers import KeypointReceiver, MotionReceiver
from services.live.room import Room, facing_yaw
from services.live.sessions.view_sessions import ViewSessions
from services.meetings import create_meeting
from tests.capture.people import JOINT, body, standing
from tests.services import seeds
from tests.services.live.people import seen
from tests.services.live.viewer import Viewer

PACE_S = 1.0 / 60.0


def count(outcome: str) -> float:
    """Packets that this became of, so far."""
    return REGISTRY.get_sample_value("metanerf_keypoints_total", {"outcome": outcome}) or 0.0


def outcome(name: str) -> float:
    """Motion packets that this became of, so far."""
    return REGISTRY.get_sample_value("metanerf_motions_total", {"outcome": name}) or 0.0


async def until(look: Callable[[], bool], what: str) -> None:
    for _ in range(1200):
        if look():
            return
        await asyncio.sleep(0.05)
    raise AssertionError(f"{what} did not happen")


@pytest.fixture
def meeting_id(services: Services, model_file: Path) -> str:
    """Ada of account `house` and Bo of `elsewhere` in one room."""
    ada = seeds.imported(services, model_file, "house", "Ada")
    bo = seeds.imported(services, model_file, "elsewhere", "Bo")
    with services.unit_of_work() as unit:
        meeting = create_meeting(services, unit, "house", "Monday", [ada, bo])
        unit.commit()
    return meeting.id


@pytest.fixture
async def room(app: FastAPI, meeting_id: str) -> Room:
    """The room that every viewer of the meeting will look into."""
    views: ViewSessions = gateway_of(app).views
    return await views.room(meeting_id)


async def connected(
    app: FastAPI, meeting_id: str, account: str, performer_id: str, label: str = "keypoints"
):
    """A viewer of `account` with a channel that would drive the performer."""
    views: ViewSessions = gateway_of(app).views
    viewer = Viewer()
    channel = viewer.peer.createDataChannel(
        label, ordered=False, maxRetransmits=0, protocol=performer_id
    )
    told: list[Any] = []
    channel.on("message", told.append)
    _, answer = await views.open(meeting_id, await viewer.offer(), None, account)
    await viewer.accept(answer)
    return viewer, channel, told


async def send(channel: RTCDataChannel, packets: list[KeypointsPacket]) -> None:
    await until(lambda: channel.readyState == "open", "opening the channel")
    for packet in packets:
        channel.send(encode_keypoints(packet))
        await asyncio.sleep(PACE_S)


def member(room: Room, name: str):
    return next(one for one in room.performers if one.name == name)


def waving() -> list[KeypointsPacket]:
    motion = standing(45)
    return [seen(motion.pose(index), index) for index in range(45)]


async def test_keypoints_move_the_performer_and_nobody_else(app, room, meeting_id):
    ada, bo = member(room, "Ada"), member(room, "Bo")
    viewer, channel, told = await connected(app, meeting_id, "house", ada.performer_id)
    await until(lambda: ada.performer_id in room.live_motions, "driving")
    recorded = room.scene_at(0.0)
    # the first packet may find kernels to compile; what comes meanwhile is replaced
    solved = count("solved")
    await send(channel, waving()[:1])
    await until(lambda: count("solved") > solved, "the first pose")
    await send(channel, waving()[1:])
    driven = room.live_motions[ada.performer_id]
    assert isinstance(driven, LiveMotion)
    last_s = waving()[-1].capture_time_ms / 1e3
    last_ms = waving()[-1].capture_time_ms
    await until(lambda: driven.captured_ms == pytest.approx(last_ms, abs=1e-6), "the last")
    assert driven.clock_offset_s is not None
    now_s = last_s + driven.clock_offset_s
    shown = room.scene_at(now_s).performers[room.performers.index(ada)].pose.joint_angles
    truth = standing(45).pose(44).joint_angles
    arms = [JOINT[f"{side}_{part}"] for side in ("left", "right") for part in ("shoulder", "elbow")]
    assert np.abs(shown - truth)[arms].max() < 0.2
    assert np.abs(recorded.performers[0].pose.joint_angles - truth)[arms].max() > 0.25
    assert bo.performer_id not in room.live_motions
    malformed = count("malformed")
    channel.send(b"no packet of ours")
    channel.send("nor this")
    await until(lambda: count("malformed") == malformed + 2, "counting nonsense")
    assert told == []
    await viewer.peer.close()
    # whoever goes leaves their performer to the recorded motion
    await until(lambda: room.live_motions == {}, "letting go")
    assert room.scene_at(0.0).performers[0].pose.joint_angles == pytest.approx(
        recorded.performers[0].pose.joint_angles
    )


@pytest.mark.parametrize(
    ("account", "who", "status", "words"),
    [
        ("house", "Bo", 403, "must be of the account whose person is driven; got one of 'house'"),
        (None, "Ada", 403, "got one of None"),
        ("house", None, 404, "must be the id of a performer of this meeting; got 'nobody'"),
    ],
)
async def test_others_are_refused_in_words(app, room, meeting_id, account, who, status, words):
    performer_id = member(room, who).performer_id if who else "nobody"
    viewer, channel, told = await connected(app, meeting_id, account, performer_id)
    await until(lambda: channel.readyState == "closed", "closing the channel")
    problem = json.loads(told[0])
    assert problem["status"] == status
    assert words in problem["detail"]
    assert room.live_motions == {}
    await viewer.peer.close()


async def test_a_newer_channel_takes_over(app, room, meeting_id):
    performer_id = member(room, "Ada").performer_id
    first, before, told = await connected(app, meeting_id, "house", performer_id)
    await until(lambda: performer_id in room.live_motions, "driving")
    motion = room.live_motions[performer_id]
    second, after, _ = await connected(app, meeting_id, "house", performer_id)
    await until(lambda: before.readyState == "closed", "closing the older one")
    assert json.loads(told[0])["status"] == 409
    assert room.live_motions[performer_id] is not motion
    await until(lambda: after.readyState == "open", "opening the newer one")
    await first.peer.close()
    assert performer_id in room.live_motions
    # whoever is sent out drives nobody any more
    await gateway_of(app).views.close_unless(meeting_id, lambda _: False)
    await until(lambda: room.live_motions == {}, "letting go")
    await second.peer.close()


def consent(services: Services, name: str, *purposes: Purpose) -> None:
    """Have the person of that name consent to these, and to nothing else."""
    with services.unit_of_work() as unit:
        (person,) = [
            one
            for account in ("house", "elsewhere")
            for one in unit.people.of_account(account)
            if one.name == name
        ]
        give_consent(person, purposes, None, services.clock())
        unit.commit()


async def test_others_drive_by_consent_and_stop_when_it_is_withdrawn(
    app, room, meeting_id, services
):
    bo = member(room, "Bo").performer_id
    consent(services, "Bo", Purpose.MEETINGS, Purpose.DRIVING)
    views = gateway_of(app).views
    await views.refresh(meeting_id)
    viewer, channel, told = await connected(app, meeting_id, "house", bo)
    await until(lambda: bo in room.live_motions, "driving")
    # it is nobody's but the owner's to show what they look like now
    assert room.looks == {}
    consent(services, "Bo", Purpose.MEETINGS)
    await views.refresh(meeting_id)
    assert room.live_motions == {}
    await until(lambda: channel.readyState == "closed", "closing the channel")
    assert "ask the owner for their consent" in json.loads(told[0])["detail"]
    await viewer.peer.close()


async def test_nobody_takes_over_from_the_owner_but_the_owner(app, room, meeting_id, services):
    bo = member(room, "Bo").performer_id
    consent(services, "Bo", Purpose.MEETINGS, Purpose.DRIVING)
    await gateway_of(app).views.refresh(meeting_id)
    guest, lent, _ = await connected(app, meeting_id, "house", bo)
    await until(lambda: bo in room.live_motions, "driving")
    owner, own, _ = await connected(app, meeting_id, "elsewhere", bo)
    await until(lambda: lent.readyState == "closed", "closing the guest's")
    motion = room.live_motions[bo]
    again, refused, told = await connected(app, meeting_id, "house", bo)
    await until(lambda: refused.readyState == "closed", "refusing the guest")
    assert "while the owner drives" in json.loads(told[0])["detail"]
    assert (room.live_motions[bo], own.readyState) == (motion, "open")
    for one in (guest, owner, again):
        await one.peer.close()


async def test_who_is_shown_no_longer_is_driven_no_longer(app, room, meeting_id, services):
    ada = member(room, "Ada").performer_id
    viewer, channel, told = await connected(app, meeting_id, "house", ada)
    await until(lambda: ada in room.live_motions, "driving")
    consent(services, "Ada")
    await gateway_of(app).views.refresh(meeting_id)
    assert (room.live_motions, [one.name for one in room.performers]) == ({}, ["Bo"])
    await until(lambda: channel.readyState == "closed", "closing the channel")
    assert "their consent has ended" in json.loads(told[0])["detail"]
    await viewer.peer.close()


def test_of_packets_that_wait_the_newest_wins():
    motion, executor = LiveMotion(body().skeleton), ThreadPoolExecutor(1)
    receiver = KeypointReceiver(motion, executor, lambda: 100.0)
    busy = threading.Event()
    executor.submit(busy.wait, 20.0)
    packets = waving()[:6]
    before = {name: count(name) for name in ("solved", "late", "replaced", "malformed")}
    for packet in [packets[0], packets[3], packets[1], packets[5], packets[5]]:
        receiver.receive(encode_keypoints(packet))
    receiver.receive(encode_keypoints(packets[2])[:-1])
    busy.set()
    executor.shutdown(wait=True)
    gained = {name: count(name) - before[name] for name in before}
    assert gained == {"solved": 1.0, "late": 2.0, "replaced": 2.0, "malformed": 1.0}
    assert motion.captured_ms == pytest.approx(packets[5].capture_time_ms)


def motions() -> list[bytes]:
    """What a page sends that has solved the packets of somebody who waves."""
    solver = MotionSolver(body().skeleton)
    return [
        encode_motion(MotionPacket(1 + number, solver.solve(packet)))
        for number, packet in enumerate(waving())
    ]


async def test_motion_that_a_page_has_solved_is_followed_and_nothing_is_solved_here(
    app, room, meeting_id
):
    ada = member(room, "Ada")
    viewer, channel, told = await connected(app, meeting_id, "house", ada.performer_id, "motion")
    await until(lambda: channel.readyState == "open", "opening the channel")
    solved, followed = count("solved"), outcome("followed")
    channel.send("whose?")
    await until(lambda: told != [], "telling the body")
    assert told == [encode_body(ada.model.skeleton, -facing_yaw(ada.motion))]
    for packet in motions():
        channel.send(packet)
        await asyncio.sleep(PACE_S)
    await until(lambda: outcome("followed") == followed + 45, "following all")
    driven = room.live_motions[ada.performer_id]
    assert isinstance(driven, LiveMotion)
    assert driven.clock_offset_s is not None
    last = waving()[-1]
    assert driven.captured_ms == pytest.approx(last.capture_time_ms)
    shown = driven.pose_at(last.capture_time_ms / 1e3 + driven.clock_offset_s)
    reference = LiveMotion(body().skeleton)
    for packet in waving():
        reference.update(packet, packet.capture_time_ms / 1e3)
    expected = reference.pose_at(last.capture_time_ms / 1e3)
    assert shown is not None
    assert expected is not None
    np.testing.assert_allclose(shown.joint_angles, expected.joint_angles, atol=1e-3)
    np.testing.assert_allclose(shown.root_translation, expected.root_translation, atol=1e-5)
    assert count("solved") == solved
    malformed = outcome("malformed")
    channel.send(b"no packet of ours")
    await until(lambda: outcome("malformed") == malformed + 1, "counting nonsense")
    await viewer.peer.close()
    await until(lambda: room.live_motions == {}, "letting go")


def test_whoever_rests_stands_the_same_whoever_solved_them():
    ours, theirs = LiveMotion(body().skeleton), LiveMotion(body().skeleton)
    for packet, data in zip(waving(), motions(), strict=True):
        ours.update(packet, packet.capture_time_ms / 1e3)
        theirs.follow(decode_motion(data).motion, packet.capture_time_ms / 1e3)
    for gap_s in (0.1, 0.5, 3.0):
        now_s = waving()[-1].capture_time_ms / 1e3 + gap_s
        one, other = ours.pose_at(now_s), theirs.pose_at(now_s)
        assert one is not None
        assert other is not None
        np.testing.assert_allclose(one.joint_angles, other.joint_angles, atol=5e-3)
        np.testing.assert_allclose(one.root_translation, other.root_translation, atol=1e-3)


def test_of_keypoints_more_than_any_webcam_gives_are_dropped():
    clock = iter(np.arange(300) / 1000.0)
    executor = ThreadPoolExecutor(1)
    receiver = KeypointReceiver(
        LiveMotion(body().skeleton), executor, lambda: 100.0 + float(next(clock, 0.4))
    )
    before = count("flood")
    data = encode_keypoints(waving()[0])
    for _ in range(200):
        receiver.receive(data)
    executor.shutdown()
    assert count("flood") == before + 70


def test_of_motion_what_is_late_implausible_or_too_much_is_dropped():
    clock = iter(np.arange(2000) / 1000.0)
    motion = LiveMotion(body().skeleton)
    receiver = MotionReceiver(motion, lambda: 100.0 + float(next(clock)))
    names = ("followed", "late", "implausible", "malformed", "flood")
    before = {name: outcome(name) for name in names}
    packets = motions()
    jump = bytearray(packets[8])
    struct.pack_into("<f", jump, 16, 2.9)
    older = bytearray(packets[0])
    struct.pack_into("<I", older, 4, 90)
    for packet in (packets[0], packets[4], packets[2], bytes(jump), bytes(older), packets[0][:-1]):
        receiver.receive(packet)
    assert motion.captured_ms == pytest.approx(waving()[4].capture_time_ms)
    for _ in range(200):
        receiver.receive("whose?")
    receiver.receive(packets[10])
    gained = {name: outcome(name) - before[name] for name in names}
    told = {"followed": 2.0, "late": 1.0, "implausible": 2.0, "malformed": 1.0, "flood": 77.0}
    assert gained == told
    assert motion.captured_ms == pytest.approx(waving()[4].capture_time_ms)
