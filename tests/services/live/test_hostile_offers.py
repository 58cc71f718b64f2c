"""Offers and frames of anybody: the gateway itself reads them, and says no more than an error."""

from __future__ import annotations

import asyncio
from concurrent.futures import ThreadPoolExecutor

import pytest
from aiortc import RTCConfiguration, RTCPeerConnection
from hypothesis import given
from hypothesis import strategies as st

from scene.errors import SceneError
from services.errors import OfferRefused
from services.live.look.packets import is_key_frame
from services.live.look.picture_code import PictureCode
from services.live.look.receiver import LookReceiver, key_frame_size, offers_pictures
from services.live.sessions import view_offer
from services.live.sessions.voice_offer import Endpoint, read_media_sections
from services.live.streaming.encoding import negotiated_codec
from tests.few_examples import FEW, damaged
from tests.services.live.look_pictures import Encoder, KeptPictures, frame_of


async def _offer() -> str:
    peer = RTCPeerConnection(RTCConfiguration(iceServers=[]))
    peer.createDataChannel("view")
    peer.addTransceiver("video", direction="recvonly")
    peer.addTransceiver("audio", direction="sendrecv")
    await peer.setLocalDescription(await peer.createOffer())
    sdp = peer.localDescription.sdp
    await peer.close()
    return sdp


@pytest.fixture(scope="module")
def offer() -> str:
    return asyncio.run(_offer())


def test_offers(offer: str):
    refused = 0

    @FEW
    @given(data=damaged(offer.encode()) | st.text(max_size=60).map(str.encode))
    def attack(data: bytes) -> None:
        nonlocal refused
        sdp = data.decode(errors="replace")
        for endpoint in Endpoint:
            try:
                read_media_sections(sdp, endpoint)
            except OfferRefused:
                refused += 1
        for read in (view_offer.require_few_sections, view_offer.require_no_media):
            try:
                read(sdp)
            except SceneError:
                refused += 1
        offers_pictures(sdp)

    attack()
    assert refused > 0


def test_offers_that_ask_for_a_codec(offer: str):
    @FEW
    @given(data=damaged(offer.encode()))
    def attack(data: bytes) -> None:
        negotiated_codec(data.decode(errors="replace"))

    attack()


def test_frames_for_live_look():
    whole = Encoder().encode(frame_of(PictureCode(66, -20, 30, 360)))
    assert key_frame_size(whole) is not None

    @FEW
    @given(frames=st.lists(damaged(whole[:400]) | st.binary(max_size=20), max_size=4))
    def attack(frames: list[bytes]) -> None:
        for frame in frames:
            size = key_frame_size(frame)
            assert size is None or (is_key_frame(frame) and max(size) < 1 << 14)

    attack()


async def test_no_frame_stops_those_that_follow():
    whole = Encoder().encode(frame_of(PictureCode(66, -20, 30, 360)))
    sink = KeptPictures()

    async def ask() -> None:
        pass

    with ThreadPoolExecutor(1) as executor:
        receiver = LookReceiver(executor, ask)
        receiver.attach(sink)
        receiver.announce(True)
        for frame in (b"", b"\0", whole[:9], b"\0" * 200_000, whole[:10] + b"\xff" * 9):
            receiver.on_frame(frame)
        async with asyncio.timeout(60):
            while not sink.pictures:
                receiver.on_frame(whole)
                await asyncio.sleep(0.1)
        receiver.close()
