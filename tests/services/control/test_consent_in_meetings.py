"""A consent that ends takes a person out of meetings that run, on every gateway, within a second or
so: out of pictures, poses and rosters, and their model's file is handed out no more."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable, Iterator
from datetime import timedelta
from pathlib import Path

import httpx
import numpy as np
import pytest

from services.app import create_app
from services.composition import build_services
from services.container import Services
from services.settings import load_settings
from tests.services import seeds
from tests.services.conftest import SECRET, bearer
from tests.services.control.conftest import on_a_port
from tests.services.control.page import Page, join
from tests.services.control.test_outage import beat, look
from tests.services.control.test_voices import seat_of
from tests.services.live.test_drawing_viewers import newest
from tests.services.live.test_drawing_viewers import view as own_view
from tests.services.live.viewer import Viewer

AT_ONCE_S = 1.5


@pytest.fixture
def deployed(tmp_path: Path, postgres_url: str, redis_url: str) -> Iterator[Services]:
    """Services as they are deployed: PostgreSQL and Redis."""
    settings = load_settings(
        data_dir=tmp_path / "data",
        jwt_secret=SECRET,
        open_access=True,
        embedded_worker=False,
        client_dir=tmp_path / "no-page",
        database_url=postgres_url,
        redis_url=redis_url,
    )
    made = build_services(settings)
    made.database.migrate()
    yield made
    made.close()


async def performers(page: Page, fits: Callable[[list[str]], bool]) -> list[str]:
    """Who is shown, by the newest roster, once that fits."""

    def told() -> list[list[str]]:
        return [m["performer_ids"] for m in page.heard if m["type"] == "roster"]

    await page.until(lambda: bool(told()) and fits(told()[-1]), "other performers")
    return told()[-1]


async def other_picture(viewer: Viewer, than: np.ndarray) -> np.ndarray:
    """The next picture in whose middle something else is to be seen."""
    middle = slice(50, 110)
    while True:
        picture = await viewer.frame()
        if picture.shape == than.shape:
            changed = np.abs(picture.astype(int) - than)[middle, middle].mean()
            if changed > 8.0:
                return picture


async def test_who_revokes_is_seen_no_longer_on_any_gateway(deployed: Services, model_file: Path):
    ada_model = seeds.imported(deployed, model_file, "house", "Ada")
    cy_model = seeds.imported(deployed, model_file, "house", "Cy")
    other = build_services(deployed.settings)  # a process of its own, as far as it can tell
    apps = [create_app(deployed), create_app(other)]
    async with on_a_port(apps[0], deployed) as here, on_a_port(apps[1], other) as there:
        body = {"name": "Monday", "model_ids": [ada_model.id]}
        meeting = (await here.post("/v1/meetings", json=body)).json()
        guest = bearer(deployed, "guest-bo")
        consent = f"/v1/people/{ada_model.person_id}/consent"
        viewer_file = f"/v1/models/{ada_model.id}/files/viewer.splats"
        async with (
            await join(here, meeting["id"], "Ada") as ada,
            await join(there, meeting["id"], "Bo", headers=guest) as bo,
        ):
            beating = [asyncio.create_task(beat(page)) for page in (ada, bo)]
            assert await performers(bo, bool) == [meeting["performers"][0]["id"]]
            members = await bo.roster(lambda who: set(who) == {"Ada", "Bo"})
            assert members["Ada"]["performer_id"] == meeting["performers"][0]["id"]
            watching = await look(there, meeting["id"], bo)  # the server draws
            drawing, poses = Viewer(), asyncio.Queue[bytes]()  # and here the page does
            channel = drawing.peer.createDataChannel("pose", ordered=False, maxRetransmits=0)
            channel.on("message", poses.put_nowait)
            await drawing.look(there, meeting["id"], seat_of(bo))
            await drawing.opened()
            drawing.channel.send(own_view(1, draws_itself=True))
            assert (await newest(poses)).count == 1
            file = await there.get(viewer_file, headers=seat_of(bo))
            assert file.status_code == 200
            before = await watching.frame_of_size(160)

            begun_s = time.monotonic()
            assert (await here.delete(consent)).json()["state"] == "revoked"
            await performers(bo, lambda shown: shown == [])
            await other_picture(watching, before)
            took_s = time.monotonic() - begun_s
            assert took_s < AT_ONCE_S
            refused = await there.get(viewer_file, headers=seat_of(bo))
            assert (refused.status_code, refused.json()["type"]) == (403, "urn:metanerf:no-consent")
            await asyncio.sleep(0.1)
            while not poses.empty():
                poses.get_nowait()
            await asyncio.sleep(0.3)
            assert poses.empty()  # there is nobody whose poses could be sent
            members = await bo.roster(lambda who: who["Ada"]["performer_id"] is None)
            assert set(members) == {"Ada", "Bo"}  # who talks stays, only the likeness is gone
            await ada.say(type="say", text="still here")
            await bo.hear("said", text="still here")

            # others may come meanwhile, and whoever gives the consent again is back at their place
            stand = {"model_id": cy_model.id}
            await there.post(f"/v1/meetings/{meeting['id']}/performers", json=stand)
            await performers(bo, lambda shown: len(shown) == 1)
            assert (await here.put(consent, json={"purposes": ["meetings"]})).status_code == 200
            shown = await performers(bo, lambda shown: len(shown) == 2)
            assert shown[0] == meeting["performers"][0]["id"]
            assert (await newest(poses)).count in (1, 2)
            assert (ada.closed, bo.closed) == (False, False)
            for one in beating:
                one.cancel()
            for one in (watching, drawing):
                await one.peer.close()
    other.close()


async def test_a_consent_that_ends_takes_its_person_out_by_itself(
    caller: httpx.AsyncClient, timed: Services, clock, model_file: Path
):
    model = seeds.imported(timed, model_file, "house", "Ada")
    body = {"name": "Monday", "model_ids": [model.id]}
    meeting = (await caller.post("/v1/meetings", json=body)).json()
    until = (clock.now + timedelta(seconds=3)).isoformat()
    consent = f"/v1/people/{model.person_id}/consent"
    await caller.put(consent, json={"purposes": ["meetings"], "until": until})
    async with await join(caller, meeting["id"], "Ada") as ada:
        await performers(ada, lambda shown: len(shown) == 1)
        viewer = await look(caller, meeting["id"], ada)
        before = await viewer.frame_of_size(160)
        await ada.beat()
        clock.advance(seconds=3)
        async with asyncio.timeout(1.0 + AT_ONCE_S):  # a look a second, and then at once
            await performers(ada, lambda shown: shown == [])
            await other_picture(viewer, before)
        assert (await caller.get(consent)).json()["state"] == "ended"
        await viewer.peer.close()


async def test_who_comes_while_a_consent_ends_does_not_see_the_person(
    services: Services, model_file: Path, monkeypatch: pytest.MonkeyPatch
):
    """What a viewer was given may be older than what the hub looked at since."""
    from services.live.sessions import stored_meetings

    app, model = create_app(services), seeds.imported(services, model_file, "house", "Ada")
    loaded = stored_meetings.load_performers

    def slowly(services: Services, meeting_id: str):
        found = loaded(services, meeting_id)
        if not revoked.is_set():
            with services.unit_of_work() as unit:
                unit.people.get(model.person_id).consent_revoked_at = services.clock()
                unit.commit()
            revoked.set()
        return found

    revoked = threading.Event()
    monkeypatch.setattr(stored_meetings, "load_performers", slowly)
    async with on_a_port(app, services) as caller:
        body = {"name": "Monday", "model_ids": [model.id]}
        meeting_id = (await caller.post("/v1/meetings", json=body)).json()["id"]
        async with await join(caller, meeting_id, "Bo") as bo:
            viewer = Viewer()
            await viewer.look(caller, meeting_id, seat_of(bo))
            await performers(bo, lambda shown: shown == [])
            views = app.state.gateway.views
            async with asyncio.timeout(AT_ONCE_S):
                while (await views.room(meeting_id)).performers:
                    await asyncio.sleep(0.05)
            await viewer.peer.close()
