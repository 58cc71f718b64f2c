"""WHIP as RFC 9725 has it, by a client that is not ours, and by clients that mean no good."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction

import httpx
import numpy as np
import pytest
from aiortc import MediaStreamTrack, RTCConfiguration, RTCPeerConnection, RTCSessionDescription
from aiortc.sdp import candidate_to_sdp
from av import VideoFrame

from services.app import create_app
from services.container import Services
from services.gateway import gateway_of
from services.live.sessions.voice_sessions import VoiceSessions
from tests.services.conftest import bearer, changed
from tests.services.control.test_voices import Tone

FRAGMENT = "application/trickle-ice-sdpfrag"


class Screen(MediaStreamTrack):
    """A picture that gets brighter."""

    kind = "video"

    def __init__(self) -> None:
        super().__init__()
        self._count = 0

    async def recv(self) -> VideoFrame:
        await asyncio.sleep(1 / 20)
        self._count += 1
        value = 60 + self._count % 120
        frame = VideoFrame.from_ndarray(np.full((96, 128, 3), value, np.uint8), format="rgb24")
        frame.pts, frame.time_base = 4500 * self._count, Fraction(1, 90_000)
        return frame


class Client:
    """A WHIP client: plain aiortc and HTTP."""

    def __init__(self, caller: httpx.AsyncClient, meeting_id: str, token: str) -> None:
        self.caller, self.address = caller, f"/whip/{meeting_id}"
        self.header = {"Authorization": f"Bearer {token}"}
        self.peer = RTCPeerConnection(RTCConfiguration(iceServers=[]))
        self.location = self.etag = ""

    async def offer(self, *tracks: MediaStreamTrack) -> str:
        for track in tracks:
            self.peer.addTransceiver(track, direction="sendonly")
        await self.peer.setLocalDescription(await self.peer.createOffer())
        return self.peer.localDescription.sdp

    async def post(self, sdp: str, kind: str = "application/sdp") -> httpx.Response:
        headers = self.header | {"Content-Type": kind}
        answer = await self.caller.post(self.address, content=sdp, headers=headers)
        if answer.status_code == 201:
            self.location, self.etag = answer.headers["location"], answer.headers["etag"]
        return answer

    async def accept(self, answer: httpx.Response) -> None:
        await self.peer.setRemoteDescription(RTCSessionDescription(answer.text, "answer"))

    async def connected(self) -> None:
        async with asyncio.timeout(20):
            while self.peer.connectionState != "connected":
                await asyncio.sleep(0.02)

    async def patch(self, text: str, **headers: str) -> httpx.Response:
        fields = {key.replace("_", "-"): value for key, value in headers.items()}
        all_headers = self.header | {"Content-Type": FRAGMENT} | fields
        return await self.caller.patch(self.location, content=text, headers=all_headers)


async def seat(caller: httpx.AsyncClient, meeting_id: str, name: str = "Ada") -> dict:
    joined = await caller.post(f"/v1/meetings/{meeting_id}/join", json={"display_name": name})
    return joined.json()


@pytest.fixture
async def meeting_id(caller) -> str:
    return (await caller.post("/v1/meetings", json={"name": "Monday"})).json()["id"]


@pytest.fixture
async def whip(caller, meeting_id):
    made = Client(caller, meeting_id, (await seat(caller, meeting_id))["token"])
    yield made
    await made.peer.close()


async def test_a_foreign_client_connects_and_ends(app, whip):
    answer = await whip.post(await whip.offer(Tone()))
    assert answer.status_code == 201
    assert answer.headers["content-type"].startswith("application/sdp")
    assert answer.headers["accept-patch"] == FRAGMENT
    assert "a=rtcp-mux-only" in answer.text
    assert "a=recvonly" in answer.text
    await whip.accept(answer)
    await whip.connected()
    gone = await whip.caller.delete(whip.location, headers=whip.header)
    assert gone.status_code == 200
    assert len(gateway_of(app).voices) == 0
    assert (await whip.caller.delete(whip.location, headers=whip.header)).status_code == 204
    assert (await whip.patch("", If_Match=whip.etag)).status_code == 404


async def test_candidates_may_come_later(whip):
    offer = await whip.offer(Tone())
    transport = whip.peer.getTransceivers()[0].sender.transport.transport
    candidates = transport.iceGatherer.getLocalCandidates()
    bare = "".join(
        line
        for line in offer.splitlines(keepends=True)
        if not line.startswith(("a=candidate", "a=end-of-candidates"))
    )
    answer = await whip.post(bare)
    await whip.accept(answer)
    ufrag = transport.iceGatherer.getLocalParameters().usernameFragment
    fragment = f"a=ice-ufrag:{ufrag}\r\nm=audio 9 RTP/AVP 0\r\na=mid:0\r\n"
    fragment += "".join(f"a=candidate:{candidate_to_sdp(one)}\r\n" for one in candidates)
    told = await whip.patch(fragment + "a=end-of-candidates\r\n", If_Match=whip.etag)
    assert (told.status_code, told.content) == (204, b"")
    await whip.connected()


async def test_patches_that_do_not_fit_are_refused(whip):
    first = await whip.post(await whip.offer(Tone()))
    stale = first.headers["etag"]
    assert (await whip.patch("")).status_code == 428
    assert (await whip.patch("", If_Match='"another"')).status_code == 412
    restart = await whip.patch("a=ice-ufrag:new\r\na=ice-pwd:new\r\n", If_Match="*")
    assert restart.status_code == 422
    assert "post a new offer" in restart.json()["detail"]
    other = await whip.patch("a=ice-ufrag:new1\r\n", If_Match=whip.etag)
    assert other.status_code == 422
    bad = await whip.patch("m=audio 9 X 0\r\na=candidate:nonsense\r\n", If_Match=whip.etag)
    assert bad.status_code == 400
    kind = await whip.patch("", If_Match=whip.etag, Content_Type="application/sdp")
    assert kind.status_code == 415
    assert (await whip.patch("x" * 20_000, If_Match=whip.etag)).status_code == 413
    many = "m=audio 9 X 0\r\n" + 65 * "a=candidate:1 1 udp 2 192.0.2.7 5000 typ host\r\n"
    assert (await whip.patch(many, If_Match=whip.etag)).status_code == 413
    # a second session takes the place of the first, whose ETag opens nothing more
    again = Client(whip.caller, whip.address.removeprefix("/whip/"), "")
    again.header = whip.header
    assert (await again.post(await again.offer(Tone()))).status_code == 201
    assert (await again.patch("", If_Match=stale)).status_code == 412
    assert (await whip.patch("", If_Match=stale)).status_code == 404
    await again.peer.close()


@pytest.mark.parametrize(
    ("sdp", "kind", "status"),
    [
        ("v=0", "text/plain", 415),
        ("x" * 70_000, "application/sdp", 413),
        ("v=0 nonsense", "application/sdp", 422),
        ("", "application/sdp", 422),
        ("v=0\r\n" + 400 * "m=audio 9 RTP/AVP 111\r\na=sendonly\r\n", "application/sdp", 422),
        ("v=0\r\nm=application 9 UDP/DTLS/SCTP webrtc-datachannel\r\n", "application/sdp", 422),
        ("v=0\r\nm=audio 9 UDP/TLS/RTP/SAVPF 111\r\na=sendrecv\r\n", "application/sdp", 422),
        ("v=0\r\nm=audio 9 UDP/TLS/RTP/SAVPF 0\r\na=sendonly\r\n", "application/sdp", 422),
    ],
)
async def test_offers_that_can_not_be_are_refused(app, whip, sdp, kind, status):
    answer = await whip.post(sdp, kind)
    assert answer.status_code == status
    assert answer.json()["detail"]
    assert len(gateway_of(app).voices) == 0


async def test_who_may_send(services, caller, whip, meeting_id):
    offer = await whip.offer(Tone())
    whip.header = {}
    del caller.headers["Authorization"]
    assert (await whip.post(offer)).status_code == 401
    whip.header = {"Authorization": "Bearer none.of.ours"}
    assert (await whip.post(offer)).status_code == 401
    # an account's own token has no seat that a voice could come from
    whip.header = bearer(services)
    assert (await whip.post(offer)).status_code == 403


async def test_nobody_ends_or_feeds_anothers_session(caller, whip, meeting_id):
    await whip.post(await whip.offer(Tone()))
    other = await seat(caller, meeting_id, "Bo")
    header = {"Authorization": f"Bearer {other['token']}"}
    assert (await caller.delete(whip.location, headers=header)).status_code == 404
    whip.header = header
    assert (await whip.patch("", If_Match=whip.etag)).status_code == 404


@pytest.mark.parametrize("changes", [{"max_voices": 0}])
async def test_a_full_server_says_when_to_come_back(whip):
    answer = await whip.post(await whip.offer(Tone()))
    assert answer.status_code == 503
    assert int(answer.headers["retry-after"]) > 0


async def test_what_a_door_takes_is_told_without_a_token(caller, whip):
    del caller.headers["Authorization"]
    for address in (whip.address, whip.address.replace("whip", "whep")):
        told = await caller.options(address)
        assert told.status_code == 204
        assert told.headers["accept-post"] == "application/sdp"
        for method in ("GET", "PUT"):
            assert (await caller.request(method, address)).status_code == 405


async def test_pages_of_other_origins_are_told_what_they_need(services, meeting_id):
    settings = changed(
        services.settings, allowed_origins=["https://other.example"], ice_servers=["stun:192.0.2.1"]
    )
    app = create_app(replace(services, settings=settings))
    origin = {"Origin": "https://other.example"}
    async with httpx.AsyncClient(
        transport=httpx.ASGITransport(app), base_url="http://test", headers=origin
    ) as caller:
        asks = {
            "Access-Control-Request-Method": "PATCH",
            "Access-Control-Request-Headers": "if-match",
        }
        told = await caller.options(f"/whip/{meeting_id}", headers=asks)
        assert told.headers["access-control-allow-origin"] == "https://other.example"
        assert "PATCH" in told.headers["access-control-allow-methods"]
        refused = await caller.post(f"/whip/{meeting_id}")
        exposed = refused.headers["access-control-expose-headers"]
        for name in ("Location", "ETag", "Link", "Accept-Patch", "Retry-After"):
            assert name in exposed


async def test_ice_servers_come_as_links(services, meeting_id):
    settings = changed(services.settings, ice_servers=["stun:192.0.2.1", "stun:192.0.2.2"])
    app = create_app(replace(services, settings=settings))
    async with httpx.AsyncClient(
        transport=httpx.ASGITransport(app), base_url="http://test", headers=bearer(services)
    ) as caller:
        whip = Client(caller, meeting_id, (await seat(caller, meeting_id))["token"])
        answer = await whip.post(await whip.offer(Tone()))
    links = answer.headers.get_list("link")
    assert links == ['<stun:192.0.2.1>; rel="ice-server"', '<stun:192.0.2.2>; rel="ice-server"']
    await whip.peer.close()
    await gateway_of(app).close()


async def test_a_screen_needs_leave_and_reaches_the_others(app, caller, whip, meeting_id):
    voices: VoiceSessions = gateway_of(app).voices
    refused = await whip.post(await whip.offer(Screen()))
    assert refused.status_code == 403
    assert "ask to present first" in refused.json()["detail"]
    other = await seat(caller, meeting_id, "Bo")
    (mine,) = await _seats(app, meeting_id) - {other["participant_id"]}
    viewer = RTCPeerConnection(RTCConfiguration(iceServers=[]))
    receiver = viewer.addTransceiver("video", direction="recvonly").receiver
    await viewer.setLocalDescription(await viewer.createOffer())
    headers = {"Authorization": f"Bearer {other['token']}", "Content-Type": "application/sdp"}
    address = f"/v1/meetings/{meeting_id}/voice"
    answer = await caller.post(address, content=viewer.localDescription.sdp, headers=headers)
    await viewer.setRemoteDescription(RTCSessionDescription(answer.text, "answer"))
    await _present(app, meeting_id, mine, lambda: voices.may_present(meeting_id, mine))
    answer = await whip.post(whip.peer.localDescription.sdp)
    assert answer.status_code == 201
    await whip.accept(answer)
    frame = await asyncio.wait_for(receiver.track.recv(), 20)
    assert isinstance(frame, VideoFrame)
    assert (frame.width, frame.height) == (128, 96)
    assert 50 < frame.to_ndarray(format="rgb24").mean() < 190
    # it ends once somebody else may
    await _present(app, meeting_id, other["participant_id"], lambda: len(voices) == 1)
    await viewer.close()


async def _present(app, meeting_id: str, who: str, until: Callable[[], bool]) -> None:
    services: Services = gateway_of(app).services
    with services.unit_of_work() as unit:
        unit.meetings.get_for_change(meeting_id).presenter_id = who
        unit.meetings.heard({who: services.clock()})
        unit.commit()
    gateway_of(app).hub.notify(meeting_id)
    async with asyncio.timeout(20):
        while not until():
            await asyncio.sleep(0.02)


async def _seats(app, meeting_id: str) -> set[str]:
    with gateway_of(app).services.reading() as unit:
        return {one.id for one in unit.meetings.get(meeting_id).participants}
