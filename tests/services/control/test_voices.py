"""Voices by real WebRTC: a tone goes in on one side and comes out on the other, if it may."""

from __future__ import annotations

import asyncio
from fractions import Fraction

import httpx
import numpy as np
import pytest
from aiortc import (
    MediaStreamTrack,
    RTCConfiguration,
    RTCPeerConnection,
    RTCSessionDescription,
)
from av import AudioFrame

from services.gateway import gateway_of
from tests.services.control.page import Page, join
from tests.services.control.test_channel import header

TONE_HZ = 440.0
_RATE, _SAMPLES = 48_000, 960


class Tone(MediaStreamTrack):
    """A sine, as a microphone would give it."""

    kind = "audio"

    def __init__(self) -> None:
        super().__init__()
        self._at = 0
        self._due_s = 0.0

    async def recv(self) -> AudioFrame:
        loop = asyncio.get_running_loop()
        self._due_s = max(self._due_s + _SAMPLES / _RATE, loop.time() - 0.05)
        await asyncio.sleep(max(0.0, self._due_s - loop.time()))
        at = np.arange(self._at, self._at + _SAMPLES)
        wave = (8000 * np.sin(2 * np.pi * TONE_HZ * at / _RATE)).astype(np.int16)
        frame = AudioFrame.from_ndarray(wave[None], format="s16", layout="mono")
        frame.sample_rate, frame.pts, frame.time_base = _RATE, self._at, Fraction(1, _RATE)
        self._at += _SAMPLES
        return frame


class Headset:
    """One voice connection that says a tone all the time, and hears a few others."""

    def __init__(
        self, slots: int = 1, tone: bool = True, door: str = "/v1/meetings/{}/voice"
    ) -> None:
        self.peer = RTCPeerConnection(RTCConfiguration(iceServers=[]))
        self.door = door
        if tone:
            self.peer.addTransceiver(Tone(), direction="sendonly")
        self.slots = [
            self.peer.addTransceiver("audio", direction="recvonly").receiver for _ in range(slots)
        ]

    async def call(
        self, caller: httpx.AsyncClient, meeting_id: str, header: dict[str, str]
    ) -> httpx.Response:
        """Connect, where it is granted."""
        await self.peer.setLocalDescription(await self.peer.createOffer())
        answer = await caller.post(
            self.door.format(meeting_id),
            content=self.peer.localDescription.sdp,
            headers=header | {"Content-Type": "application/sdp"},
        )
        if answer.status_code == 201:
            description = RTCSessionDescription(answer.text, "answer")
            await self.peer.setRemoteDescription(description)
        return answer

    async def tone(self, slot: int = 0) -> bool:
        """Whether the next fifth of a second of a slot holds the tone; silence is nothing sent."""
        heard = []
        for _ in range(10):
            try:
                frame = await asyncio.wait_for(self.slots[slot].track.recv(), 0.5)
            except TimeoutError:
                return False
            assert isinstance(frame, AudioFrame)
            heard.append(frame.to_ndarray().reshape(-1, 2)[:, 0])
        samples = np.concatenate(heard).astype(float)
        spectrum = np.abs(np.fft.rfft(samples * np.hanning(len(samples))))
        loudest = np.fft.rfftfreq(len(samples), 1 / _RATE)[spectrum.argmax()]
        return bool(np.abs(samples).mean() > 500 and abs(loudest - TONE_HZ) < 15)

    async def until(self, tone: bool, slot: int = 0) -> None:
        """Wait until the tone is heard, or no longer."""
        async with asyncio.timeout(20):
            while await self.tone(slot) != tone:
                pass


def seat_of(page: Page) -> dict[str, str]:
    return {"Authorization": f"Bearer {page.token}"}


async def test_others_are_heard_while_their_microphone_is_on(caller, timed, meeting, app):
    async with (
        await join(caller, meeting["id"], "Ada") as ada,
        await join(caller, meeting["id"], "Bo", headers=header(timed, "neighbours")) as bo,
    ):
        members = await ada.roster(lambda who: set(who) == {"Ada", "Bo"})
        bo_id = members["Bo"]["id"]
        listening, talking = Headset(), Headset()
        assert (await listening.call(caller, meeting["id"], seat_of(ada))).status_code == 201
        answer = await talking.call(caller, meeting["id"], seat_of(bo))
        assert answer.status_code == 201
        assert not await listening.tone()
        await bo.say(type="microphone", on=True)
        await listening.until(True)
        assert not await talking.tone()  # nobody hears themselves
        speaking = await ada.hear("speaking", participant_ids=[bo_id])
        assert speaking["slots"][0] == bo_id
        await ada.say(type="mute", participant_id=bo_id)
        await bo.roster(lambda who: not who["Bo"]["microphone"])
        await listening.until(False)
        await bo.say(type="microphone", on=True)
        await listening.until(True)
        await ada.say(type="role", participant_id=bo_id, role="viewer")
        await listening.until(False)
        bo.heard.clear()
        await bo.say(type="microphone", on=True)
        assert "raise a hand" in (await bo.hear("refusal"))["problem"]["detail"]
        assert len(gateway_of(app).voices) == 2
        gone = await caller.delete(answer.headers["location"], headers=seat_of(bo))
        assert gone.status_code == 200
        await ada.say(type="remove", participant_id=bo_id)
        await bo.gone()
        assert len(gateway_of(app).voices) == 1
        again = Headset()
        assert (await again.call(caller, meeting["id"], seat_of(bo))).status_code == 403
        for one in (listening, talking, again):
            await one.peer.close()


async def test_each_speaker_comes_in_a_track_of_their_own(caller, timed, meeting):
    async with (
        await join(caller, meeting["id"], "Ada") as ada,
        await join(caller, meeting["id"], "Bo", headers=header(timed, "neighbours")) as bo,
        await join(caller, meeting["id"], "Cy", headers=header(timed, "others")) as cy,
    ):
        members = await ada.roster(lambda who: len(who) == 3)
        listening, first, second = Headset(slots=6, tone=False), Headset(), Headset()
        for headset, page in ((listening, ada), (first, bo), (second, cy)):
            assert (await headset.call(caller, meeting["id"], seat_of(page))).status_code == 201
        await bo.say(type="microphone", on=True)
        await listening.until(True, slot=0)
        await cy.say(type="microphone", on=True)
        await listening.until(True, slot=1)
        assert await listening.tone(0)
        both = {members["Bo"]["id"], members["Cy"]["id"]}
        told = await ada.hear_that("speaking", lambda one: set(one["participant_ids"]) == both)
        assert told["slots"][:2] == [members["Bo"]["id"], members["Cy"]["id"]]
        # who offers one track hears one voice: here nobody else, since slot 0 is their own
        assert not await first.tone(0)
        await second.until(True)
        dee = await join(caller, meeting["id"], "Dee", headers=header(timed, "late"))
        async with dee:
            assert (await dee.hear("speaking"))["slots"][:2] == told["slots"][:2]
        for one in (listening, first, second):
            await one.peer.close()


async def test_a_voice_by_whip_is_heard_in_place_of_the_pages(caller, timed, meeting, app):
    async with (
        await join(caller, meeting["id"], "Ada") as ada,
        await join(caller, meeting["id"], "Bo", headers=header(timed, "neighbours")) as bo,
    ):
        listening, page = Headset(tone=False), Headset()
        foreign = Headset(slots=0, door="/whip/{}")
        assert (await listening.call(caller, meeting["id"], seat_of(ada))).status_code == 201
        assert (await page.call(caller, meeting["id"], seat_of(bo))).status_code == 201
        answer = await foreign.call(caller, meeting["id"], seat_of(bo))
        assert answer.status_code == 201
        assert answer.headers["location"].startswith(f"/whip/{meeting['id']}/")
        await bo.say(type="microphone", on=True)
        await page.peer.close()
        await listening.until(True)
        gone = await caller.delete(answer.headers["location"], headers=seat_of(bo))
        assert gone.status_code == 200
        await listening.until(False)
        for one in (listening, foreign):
            await one.peer.close()


async def test_nobody_hears_from_the_lobby_and_the_removed_are_cut_off(caller, timed, meeting, app):
    async with (
        await join(caller, meeting["id"], "Ada") as ada,
        await join(caller, meeting["id"], "Bo", headers=header(timed, "neighbours")) as bo,
    ):
        members = await ada.roster(lambda who: set(who) == {"Ada", "Bo"})
        headset = Headset()
        assert (await headset.call(caller, meeting["id"], seat_of(bo))).status_code == 201
        await ada.say(type="remove", participant_id=members["Bo"]["id"])
        await bo.gone()
        while len(gateway_of(app).voices) > 0:
            await ada.beat()
        await headset.peer.close()
        cy = await join(caller, meeting["id"], "Cy", headers=header(timed, "others"))
        async with cy:
            await cy.roster(lambda who: who["Cy"]["admission"] == "waiting")
            waiting = Headset()
            refused = await waiting.call(caller, meeting["id"], seat_of(cy))
            assert refused.status_code == 403
            assert "wait until you are let in" in refused.json()["detail"]
            await waiting.peer.close()


@pytest.mark.parametrize(("kind", "status"), [("application/json", 415), ("application/sdp", 422)])
async def test_offers_that_are_none_are_refused(caller, meeting, app, kind, status):
    ada = await join(caller, meeting["id"], "Ada")
    answer = await caller.post(
        f"/v1/meetings/{meeting['id']}/voice",
        content=b"v=0 nonsense",
        headers=seat_of(ada) | {"Content-Type": kind},
    )
    assert answer.status_code == status
    assert len(gateway_of(app).voices) == 0
