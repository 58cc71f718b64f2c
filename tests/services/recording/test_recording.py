"""A meeting is kept while everybody agrees, shown again, filmed, and forgotten on request."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

import av
import httpx
import numpy as np
import pytest

from db.models import JobKind, RecordingState
from services.gateway import gateway_of
from services.jobs.export_job import run_export
from services.jobs.lease import JobLease
from services.jobs.report import Reporter
from services.live.packets import decode_pose, encode_pose
from services.recording.chunks import Record, records_of
from services.recording.recorder import Recorders
from services.recording.replay import load
from services.recording.video_export import CameraKeyframe, CameraPath, export_video
from services.synthetic import NOTE
from tests.services import seeds
from tests.services.api.test_environments import panorama
from tests.services.conftest import changed
from tests.services.control.page import Page, join
from tests.services.control.test_channel import header
from tests.services.control.test_voices import Headset, seat_of
from tests.services.live.look_pictures import KeptPictures
from tests.services.live.test_live_look import Sender
from tests.services.live.viewer import Viewer, view


@dataclass
class Met:
    """Ada, who hosts and stands in the room, and Bo."""

    meeting_id: str
    ada: Page
    bo: Page
    ids: dict[str, str]
    person_id: str


@asynccontextmanager
async def met(caller, timed, model_file: Path) -> AsyncIterator[Met]:
    model = seeds.imported(timed, model_file, "house", "Ada")
    body = {"name": "Monday", "model_ids": [model.id]}
    meeting_id = (await caller.post("/v1/meetings", json=body)).json()["id"]
    neighbours = header(timed, "neighbours")
    async with (
        await join(caller, meeting_id, "Ada") as ada,
        await join(caller, meeting_id, "Bo", headers=neighbours) as bo,
    ):
        members = await ada.roster(lambda who: set(who) == {"Ada", "Bo"})
        ids = {name: one["id"] for name, one in members.items()}
        viewer = Viewer()
        await viewer.look(caller, meeting_id, seat_of(ada))
        await viewer.opened()
        viewer.channel.send(view(1, 0.0, 3.0))
        try:
            yield Met(meeting_id, ada, bo, ids, model.person_id)
        finally:
            await viewer.peer.close()


async def told(page: Page, **fields) -> dict:
    """The newest roster's recording, once it is as said."""

    def newest() -> dict | None:
        rosters = [m for m in page.heard if m["type"] == "roster"]
        return rosters[-1]["recording"] if rosters else None

    def fits() -> bool:
        recording = newest()
        return recording is not None and all(
            recording[key] == value for key, value in fields.items()
        )

    await page.until(fits, f"a recording with {fields}")
    found = newest()
    assert found is not None
    return found


async def over(page: Page) -> None:
    await page.until(
        lambda: [m for m in page.heard if m["type"] == "roster"][-1]["recording"] is None,
        "the end of the recording",
    )


async def kept(caller: httpx.AsyncClient, recording_id: str, kind: str) -> dict:
    """The recording, once it has a track of that kind."""
    async with asyncio.timeout(30):
        while True:
            found = (await caller.get(f"/v1/recordings/{recording_id}")).json()
            if any(track["name"].startswith(kind) for track in found["tracks"]):
                return found
            await asyncio.sleep(0.1)


async def track(caller: httpx.AsyncClient, recording: dict, kind: str) -> list[Record]:
    (url,) = [one["url"] for one in recording["tracks"] if one["name"].startswith(kind)]
    return list(records_of((await caller.get(url)).content))


async def test_nothing_is_kept_until_all_agree_and_all_of_it_after(
    caller, timed, app, model_file, tmp_path
):
    async with met(caller, timed, model_file) as here:
        talking = Headset()
        await talking.call(caller, here.meeting_id, seat_of(here.bo))
        await here.bo.say(type="say", text="before")
        await here.ada.say(type="record", on=True)
        asked = await told(here.bo, running=False, agreed=[here.ids["Ada"]])
        assert len(gateway_of(app).hub.recorders) == 0
        await here.bo.say(type="agree", on=True)
        await told(here.bo, running=True)
        await here.bo.say(type="microphone", on=True)
        await here.bo.say(type="say", text="after")
        await here.ada.hear("said", text="after")
        await kept(caller, asked["id"], "motion")
        await here.ada.say(type="record", on=False)
        await over(here.bo)
        recording = await kept(caller, asked["id"], "voice")
        assert (recording["state"], recording["why_ended"]) == ("ended", "the host ended it")
        assert {one["name"] for one in recording["members"]} == {"Ada", "Bo"}
        moved = await track(caller, recording, "motion")
        times = [record.at_ms for record in moved]
        assert times == sorted(times)
        assert len(moved) > 30
        assert np.allclose(
            np.linalg.norm(decode_pose(moved[0].data).rotations, axis=1), 1.0, atol=1e-3
        )
        assert len(await track(caller, recording, "voice")) > 20
        assert [one.data for one in await track(caller, recording, "chat")] == [b"after"]
        voice = next(t["name"] for t in recording["tracks"] if t["name"].startswith("voice"))
        ogg = await caller.get(f"/v1/recordings/{asked['id']}/voices/{voice[6:]}.ogg")
        assert ogg.content.startswith(b"OggS")
        await talking.peer.close()
        out = tmp_path / "video.mp4"
        recorded = await asyncio.to_thread(load, timed, asked["id"])
        path = [
            CameraKeyframe(0.0, (0.0, 1.2, 3.0), (0.0, 0.9, 0.0)),
            CameraKeyframe(5.0, (2.0, 1.2, 2.0), (0, 0.9, 0)),
        ]
        camera_path = CameraPath(path, 160, 128, 0.7)
        await asyncio.to_thread(export_video, recorded, camera_path, out, lambda done: None)
        with av.open(str(out)) as video:
            assert video.metadata["comment"] == NOTE
            pictures = [one.to_ndarray(format="rgb24") for one in video.decode(video=0)]
        assert abs(len(pictures) / 30 - recorded.duration_s) < 0.2
        assert pictures[0].shape == (128, 160, 3)
        assert np.abs(pictures[0].astype(int) - pictures[-1]).max() > 40  # the camera moved
        middle = moved[len(moved) // 2]
        (stood,) = recorded.scene_at(middle.at_ms / 1000.0).performers
        pelvis = stood.model.skeleton.rest_joints[0] + stood.pose.root_translation
        assert np.allclose(pelvis, decode_pose(middle.data).pelvis, atol=1e-6)
        with av.open(str(out)) as video:
            sound = np.concatenate([one.to_ndarray() for one in video.decode(audio=0)], axis=1)
        assert np.abs(sound).max() > 0.05


async def test_pictures_of_live_look_are_shown_and_not_kept(caller, timed, app, model_file):
    async with met(caller, timed, model_file) as here:
        views, shown = gateway_of(app).views, KeptPictures()
        views.driving_channels.make_look_sink = lambda *_: shown
        room = await views.room(here.meeting_id)
        sender = Sender(room, "Ada")
        await sender.connect(views, room, "house")
        await here.ada.say(type="record", on=True)
        await told(here.bo, running=False)
        await here.bo.say(type="agree", on=True)
        asked = await told(here.ada, running=True)
        while len(shown.pictures) < 30:
            await sender.drive(0.2, live_look=True)
        await here.ada.say(type="record", on=False)
        await over(here.ada)
        recording = await kept(caller, asked["id"], "motion")
        assert {one["name"].partition(":")[0] for one in recording["tracks"]} == {"motion", "room"}
        moved = await track(caller, recording, "motion")
        assert len(moved) > 30
        # poses and nothing behind them
        assert {one.data == encode_pose(decode_pose(one.data)) for one in moved} == {True}
        recorded = await asyncio.to_thread(load, timed, asked["id"])
        (stood,) = recorded.scene_at(moved[-1].at_ms / 1000.0).performers
        assert stood.appearance is None, "in their trained colours"
        await sender.viewer.peer.close()


async def test_a_newcomer_has_it_rest_and_a_no_ends_it(caller, timed, app, model_file):
    async with met(caller, timed, model_file) as here:
        await here.ada.say(type="record", on=True)
        await told(here.bo, running=False)
        await here.bo.say(type="agree", on=True)
        running = await told(here.ada, running=True)
        read = await caller.get(f"/v1/meetings/{here.meeting_id}")
        assert read.json()["recording"] is True  # who thinks of joining is told
        cy = await join(caller, here.meeting_id, "Cy", headers=header(timed, "others"))
        async with cy:
            await told(cy, running=False)
            await told(here.ada, running=False)
            assert len(gateway_of(app).hub.recorders) == 0
            await cy.say(type="agree", on=True)
            await told(here.ada, running=True)
            await cy.say(type="agree", on=False)
            await over(here.ada)
        found = (await caller.get(f"/v1/recordings/{running['id']}")).json()
        assert found["why_ended"] == "Cy did not agree"
        await here.bo.say(type="agree", on=True)
        assert "must have been asked" in (await here.bo.hear("refusal"))["problem"]["detail"]
        here.bo.heard.clear()
        await here.bo.say(type="record", on=True)
        assert "must come from the host" in (await here.bo.hear("refusal"))["problem"]["detail"]


async def recorded_once(caller, here: Met) -> str:
    await here.ada.say(type="record", on=True)
    await told(here.bo, running=False)
    await here.bo.say(type="say", text="hello")
    await here.bo.say(type="agree", on=True)
    asked = await told(here.ada, running=True)
    await kept(caller, asked["id"], "motion")
    await here.bo.say(type="say", text="recorded")
    await here.ada.hear("said", text="recorded")
    await here.ada.say(type="record", on=False)
    await over(here.ada)
    await kept(caller, asked["id"], "chat")
    return asked["id"]


async def test_only_those_who_agreed_may_look_and_each_takes_themselves_out(
    caller, timed, app, model_file
):
    async with met(caller, timed, model_file) as here:
        recording_id = await recorded_once(caller, here)
        place = f"/v1/recordings/{recording_id}"
        strangers, bo = header(timed, "strangers"), header(timed, "neighbours")
        for path in ("", "/tracks/room", f"/tracks/motion:{here.person_id}"):
            assert (await caller.get(place + path, headers=strangers)).status_code == 403
        assert (await caller.get("/v1/recordings", headers=strangers)).json()["items"] == []
        assert (await caller.delete(place, headers=bo)).status_code == 403
        assert (await caller.delete(place + "/mine", headers=strangers)).status_code == 403
        assert len((await caller.get("/v1/recordings", headers=bo)).json()["items"]) == 1
        gone = await caller.delete(place + "/mine", headers=bo)
        assert gone.json()["chunks"] == 1
        left = (await caller.get(place)).json()
        assert [one["name"] for one in left["members"]] == ["Ada"]
        assert not any(one["name"].startswith("chat") for one in left["tracks"])
        # nobody of that name is left, so that it is not theirs to see any more
        assert (await caller.get(place, headers=bo)).status_code == 403


async def test_a_place_that_was_brought_along_is_seen_again_by_those_who_agreed(
    caller, timed, app, model_file
):
    async with met(caller, timed, model_file) as here:
        own, seat = f"/v1/meetings/{here.meeting_id}/panorama", seat_of(here.ada)
        place = f"/v1/recordings/{await recorded_once(caller, here)}/place"
        assert (await caller.get(place)).status_code == 404
        assert (await caller.get(f"{place}/picture")).status_code == 404
        brought = await caller.put(own, content=panorama(), headers=seat)
        assert brought.status_code == 200, brought.text
        found = (await caller.get(place, headers=header(timed, "neighbours"))).json()
        assert found["light"] == brought.json()["light"]
        picture = await caller.get(found["picture_url"])
        assert picture.content == (await caller.get(own, headers=seat)).content
        kept = {"If-None-Match": picture.headers["ETag"]}
        assert (await caller.get(found["picture_url"], headers=kept)).status_code == 304
        for path in (place, found["picture_url"]):
            answer = await caller.get(path, headers=header(timed, "strangers"))
            assert answer.status_code == 403


async def test_erasing_a_person_takes_them_out_and_deleting_leaves_no_byte(
    caller, timed, app, model_file
):
    async with met(caller, timed, model_file) as here:
        recording_id = await recorded_once(caller, here)
        place = f"/v1/recordings/{recording_id}"
        erased = (await caller.delete(f"/v1/people/{here.person_id}")).json()
        assert erased["remaining"] == 0
        assert erased["deleted_rows"]["recording_chunk"] >= 1
        left = (await caller.get(place)).json()
        assert not any(one["name"].startswith("motion") for one in left["tracks"])
        assert [one["name"] for one in left["members"]] == ["Bo"]
        assert (await caller.delete(place)).status_code == 204
        assert list(timed.objects.list(recording_id)) == []
        assert (await caller.get(place)).status_code == 404


async def test_a_gateway_that_dies_loses_seconds_and_the_next_goes_on(
    caller, timed, app, model_file
):
    async with met(caller, timed, model_file) as here:
        await here.ada.say(type="record", on=True)
        await told(here.bo, running=False)
        await here.bo.say(type="agree", on=True)
        asked = await told(here.ada, running=True)
        first = await kept(caller, asked["id"], "motion")
        (keeping,) = [
            one for one in asyncio.all_tasks() if one.get_name() == f"recording {asked['id']}"
        ]
        keeping.cancel()  # gone without a word, as when killed
        gateway = gateway_of(app)
        hub, views, voices = gateway.hub, gateway.views, gateway.voices
        hub.recorders = Recorders(
            timed, views.pose_packets, voices.packet_listeners, time.monotonic
        )
        hub.notify(here.meeting_id)
        async with asyncio.timeout(30):
            while True:
                again = (await caller.get(f"/v1/recordings/{asked['id']}")).json()
                if again["bytes"] > first["bytes"]:
                    break
                await asyncio.sleep(0.1)
        times = [record.at_ms for record in await track(caller, again, "motion")]
        assert times == sorted(times)


async def test_a_recording_ends_when_it_is_as_large_as_it_may_be(caller, timed, app, model_file):
    settings = changed(timed.settings, max_recording_bytes=10)
    object.__setattr__(timed, "settings", settings)
    async with met(caller, timed, model_file) as here:
        await here.ada.say(type="record", on=True)
        await told(here.bo, running=False)
        await here.bo.say(type="agree", on=True)
        asked = await told(here.ada, running=True)
        await over(here.ada)
        with timed.reading() as unit:
            ended = unit.recordings.get(asked["id"])
        assert ended.state is RecordingState.ENDED
        assert ended.why_ended == "it is as long as it may be"


@pytest.mark.parametrize("path", ["", "/tracks/room", "/videos/x", "/models/x", "/place"])
async def test_a_recording_that_is_not_there_is_told(caller, path):
    assert (await caller.get(f"/v1/recordings/none{path}")).status_code == 404


async def test_a_video_is_made_by_a_job_and_goes_with_who_is_seen_in_it(
    caller, timed, app, model_file, tmp_path
):
    async with met(caller, timed, model_file) as here:
        recording_id = await recorded_once(caller, here)
        place = f"/v1/recordings/{recording_id}"
        film_it = {"width": 96, "height": 64}
        nobody = await caller.post(
            f"{place}/export", json=film_it, headers=header(timed, "neighbours")
        )
        assert nobody.status_code == 409
        assert "a person of yours" in nobody.json()["detail"]
        asked = await caller.post(f"{place}/export", json=film_it)
        assert asked.status_code == 202
        await asyncio.to_thread(run, timed, tmp_path)
        job = (await caller.get(f"/v1/jobs/{asked.json()['id']}")).json()
        assert (job["state"], job["message"]) == ("succeeded", "the video is ready")
        (made,) = (await caller.get(place)).json()["videos"]
        mp4 = await caller.get(made["url"], headers=header(timed, "neighbours"))
        assert mp4.content[4:8] == b"ftyp"
        assert len(mp4.content) == made["bytes"]
        (moved,) = [
            t["name"][7:]
            for t in (await caller.get(place)).json()["tracks"]
            if t["name"].startswith("motion:")
        ]
        room = (await track(caller, (await caller.get(place)).json(), "room"))[0]
        assert moved.encode() in room.data
        with timed.reading() as unit:
            (model,) = unit.models.of_person(here.person_id)
        splats = await caller.get(f"{place}/models/{model.id}")
        assert splats.content[:4] == b"MNSP"
        strangers = header(timed, "strangers")
        assert (
            await caller.get(f"{place}/models/{model.id}", headers=strangers)
        ).status_code == 403
        erased = (await caller.delete(f"/v1/people/{here.person_id}")).json()
        assert erased["deleted_rows"]["recording_export"] == 1
        assert (await caller.get(made["url"])).status_code == 404


def run(services, folder: Path) -> None:
    """Do the next job, as a worker's child would."""
    with services.unit_of_work() as unit:
        job = unit.jobs.claim([JobKind.EXPORT], "test", services.clock())
        unit.commit()
    assert job is not None
    with Reporter(services, JobLease(job.id, job.person_id, job.attempt)) as reporter:
        run_export(services, job, reporter, folder)
