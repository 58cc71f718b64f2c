"""Recordings hold nobody whose consent leaves recordings out, and show nobody who withdrew it."""

from __future__ import annotations

import json

import pytest

from db.models import RecordingExportRow, new_id
from services.recording.replay import load
from tests.services.control.test_channel import header
from tests.services.control.test_voices import Headset, seat_of
from tests.services.recording.test_recording import kept, met, over, recorded_once, told, track


async def test_who_is_not_for_recordings_is_in_none(caller, timed, app, model_file):
    async with met(caller, timed, model_file) as here:
        consent = f"/v1/people/{here.person_id}/consent"
        await caller.put(consent, json={"purposes": ["meetings"]})
        talking = Headset()
        await talking.call(caller, here.meeting_id, seat_of(here.ada))
        await here.ada.say(type="microphone", on=True)
        await here.ada.say(type="record", on=True)
        await told(here.bo, running=False)
        await here.bo.say(type="agree", on=True)
        asked = await told(here.ada, running=True)
        for page, text in ((here.ada, "mine"), (here.bo, "his")):
            await page.say(type="say", text=text)
            await here.bo.hear("said", text=text)
        await kept(caller, asked["id"], "room")
        await here.ada.say(type="record", on=False)
        await over(here.ada)
        recording = await kept(caller, asked["id"], "chat")
        await talking.peer.close()
        # everybody agreed, and she is seen and heard by all: none of it is kept
        assert {one["name"] for one in recording["tracks"]} == {"room", f"chat:{here.ids['Bo']}"}
        assert {one["performer_id"] for one in recording["members"]} == {None}
        (room,) = {record.data for record in await track(caller, recording, "room")}
        assert (json.loads(room)["performers"], json.loads(room)["standing_for"]) == ([], {})
        with timed.reading() as unit:
            assert unit.recordings.with_person(here.person_id) == []
            members = unit.recordings.get(asked["id"]).members
            assert {one.person_id for one in members} == {None}


@pytest.mark.parametrize("how", ["revoked", "not for recordings"])
async def test_who_withdraws_is_shown_by_no_recording_until_they_consent_again(
    caller, timed, app, model_file, how
):
    async with met(caller, timed, model_file) as here:
        recording_id = await recorded_once(caller, here)
        place, consent = f"/v1/recordings/{recording_id}", f"/v1/people/{here.person_id}/consent"
        with timed.unit_of_work() as unit:
            (model,) = unit.models.of_person(here.person_id)
            stored = timed.objects.put(here.person_id, [b"a video"])
            video = RecordingExportRow(
                recording_id=recording_id,
                job_id=new_id(),
                person_id=here.person_id,
                bytes=stored.bytes,
                sha256=stored.sha256,
            )
            unit.recordings.add_export(video)
            unit.commit()
        recording = (await caller.get(place)).json()
        (motion,) = [one for one in recording["tracks"] if one["name"].startswith("motion")]
        bo = header(timed, "neighbours")
        paths = (motion["url"], f"{place}/models/{model.id}", f"{place}/videos/{video.job_id}")

        async def statuses() -> list[int]:
            return [(await caller.get(path, headers=bo)).status_code for path in paths]

        assert await statuses() == [200, 200, 200]
        if how == "revoked":
            await caller.delete(consent)
        else:
            await caller.put(consent, json={"purposes": ["meetings"]})
        assert await statuses() == [404, 403, 403]
        left = (await caller.get(place, headers=bo)).json()
        assert not any(one["name"].startswith("motion") for one in left["tracks"])
        assert any(one["name"].startswith("chat") for one in left["tracks"])  # Bo's own
        recorded = load(timed, recording_id)
        assert (recorded.scene_at(0.0).performers, recorded.people) == ((), frozenset())
        with timed.unit_of_work() as unit:  # one that was made without them is for whoever is left
            (stored_video,) = unit.recordings.exports([recording_id])
            stored_video.shows = sorted(recorded.people)
            unit.commit()
        assert await statuses() == [404, 403, 200]
        await caller.put(consent, json={"purposes": ["meetings", "recordings"]})
        assert await statuses() == [200, 200, 200]


async def test_who_withdraws_while_it_runs_is_kept_no_longer(caller, timed, app, model_file):
    async with met(caller, timed, model_file) as here:
        await here.ada.say(type="record", on=True)
        await told(here.bo, running=False)
        await here.bo.say(type="agree", on=True)
        asked = await told(here.ada, running=True)
        await kept(caller, asked["id"], "motion")
        consent = f"/v1/people/{here.person_id}/consent"
        await caller.put(consent, json={"purposes": ["meetings"]})
        await here.bo.say(type="say", text="after")
        await here.ada.hear("said", text="after")
        await here.bo.beat()
        await here.ada.say(type="record", on=False)
        await over(here.ada)
        await kept(caller, asked["id"], "chat")
        # shown again, to see what was kept: nothing from after
        await caller.put(consent, json={"purposes": ["meetings", "recordings"]})
        recording = (await caller.get(f"/v1/recordings/{asked['id']}")).json()
        last = (await track(caller, recording, "room"))[-1]
        assert json.loads(last.data)["performers"] == []
        moved = await track(caller, recording, "motion")
        assert moved[-1].at_ms < last.at_ms + 100
