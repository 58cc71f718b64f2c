"""The main job in a real browser: a clip goes in, a meeting comes out, the picture follows."""

from __future__ import annotations

import itertools
import json
import os
import re
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path

import av
import httpx
import numpy as np
import pytest
from playwright.sync_api import Page, Route, expect

from benchmarks.browser import open_page, running_demo
from capture.detection.network_files import POSE_MODEL
from db.models import SequenceRow, SequenceState
from services.composition import build_services
from services.container import Services
from services.settings import load_settings
from tests.e2e.viewport import frames_shown, picture
from tests.landmark_models import landmark_model
from tests.services import seeds
from tests.services.jobs.waiting import until
from tests.shared_data import shared_data

pytestmark = pytest.mark.e2e
MINUTES = 60_000


def short_clip(source: Path, out: Path, every: int) -> Path:
    """Every `every`-th frame of the real clip at half its size: what two cores capture in time."""
    with av.open(str(source)) as clip, av.open(str(out), "w") as short:
        stream = short.add_stream("libx264", rate=60 // every)
        stream.width, stream.height, stream.pix_fmt = 540, 960, "yuv420p"
        for number, frame in enumerate(clip.decode(video=0)):
            if number % every == 0:
                small = frame.reformat(width=540, height=960, format="yuv420p")
                small.pts, small.time_base = number // every, Fraction(every, 60)
                short.mux(stream.encode(small))
        short.mux(stream.encode())
    return out


def briefly(route: Route) -> None:
    """A training as the page asks for, of 12 s."""
    asked = json.loads(route.request.post_data or "")
    route.continue_(post_data=json.dumps(asked | {"budget_s": 12.0}))


def watch(page: Page, frames: int, minutes: float = 1.0) -> None:
    """Wait until `frames` more frames have been shown."""
    goal = frames_shown(page) + frames
    page.wait_for_function(
        "goal => Number(document.querySelector('[data-testid=fps]').dataset.frames) >= goal",
        arg=goal,
        timeout=minutes * MINUTES,
    )


def difference(before: bytes, after: bytes) -> float:
    a, b = (np.frombuffer(p, np.uint8).astype(int) for p in (before, after))
    return float(np.abs(a - b).mean())


def test_the_demo_meeting_follows_the_viewer(tmp_path):
    with running_demo(tmp_path / "data") as address, open_page() as page:
        page.goto(address)
        page.get_by_test_id("start-join").click()
        expect(page.get_by_test_id("live-video")).to_be_visible(timeout=MINUTES)
        page.get_by_test_id("render-mode").select_option("server", force=True)
        watch(page, 20)
        still = [picture(page)]
        watch(page, 5)
        still.append(picture(page))
        page.mouse.move(512, 384)
        page.mouse.down()
        page.mouse.move(112, 384, steps=8)
        page.mouse.up()
        page.mouse.wheel(0, -600)
        watch(page, 40)
        # the person moves a little all the time; coming closer, they fill the picture
        assert difference(still[0], picture(page)) > 2.0 * difference(*still) + 1.0
        invented = page.get_by_test_id("show-unseen")
        expect(invented).to_have_attribute("aria-pressed", "false")
        invented.click()
        expect(invented).to_have_attribute("aria-pressed", "true")
        watch(page, 10)  # the picture goes on
        page.get_by_test_id("leave").click()
        expect(page.get_by_test_id("start-join")).to_be_visible()


def viewers(address: str) -> float:
    figures = httpx.get(f"{address}metrics").text
    found = re.search(r"^metanerf_viewers (\S+)$", figures, re.MULTILINE)
    assert found is not None
    return float(found[1])


def test_whoever_closes_the_page_or_crashes_leaves_room_for_others(tmp_path):
    environment = {"METANERF_MAX_VIEWERS": "1"}
    with running_demo(tmp_path / "data", **environment) as address, open_page() as page:
        page.goto(f"{address}?size=256")
        page.get_by_test_id("start-join").click()
        watch(page, 5)
        assert viewers(address) == 1.0
        browser = page.context.browser
        assert browser is not None
        page.close()
        second = browser.new_page()
        second.goto(f"{address}?size=256")
        second.get_by_test_id("start-join").click()
        watch(second, 5)
        # pages that die say no goodbye
        running = browser.new_browser_cdp_session().send("SystemInfo.getProcessInfo")
        for process in running["processInfo"]:
            if process["type"] == "renderer":
                os.kill(process["id"], signal.SIGKILL)
        until(lambda: viewers(address) == 0.0, "noticing the crash")


def test_a_touch_device_is_told_of_touches_and_follows_them(tmp_path):
    with running_demo(tmp_path / "data") as address, open_page() as desk:
        browser = desk.context.browser
        assert browser is not None
        page = browser.new_page(viewport={"width": 390, "height": 844}, has_touch=True)
        page.goto(f"{address}?size=256")
        page.get_by_test_id("start-join").click()
        hint = page.locator("#controls-help")
        expect(hint).to_contain_text("Pinch")
        expect(hint).not_to_contain_text("W A S D")
        title = page.locator(".viewport-title").bounding_box()
        actions = page.locator(".viewport-top .viewport-actions").bounding_box()
        assert title is not None
        assert actions is not None
        assert title["x"] + title["width"] <= actions["x"], "a title makes room for the buttons"
        # a page that draws people by itself leaves the video as it is
        page.get_by_test_id("render-mode").select_option("server", force=True)
        watch(page, 30)
        still = [picture(page)]
        watch(page, 5)
        still.append(picture(page))
        line = page.context.new_cdp_session(page)

        def touch(kind: str, *places: tuple[float, float]) -> None:
            points = [{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(places)]
            line.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

        touch("touchStart", (170, 400), (220, 400))
        for step in range(1, 7):
            touch("touchMove", (170 - 10 * step, 400), (220 + 10 * step, 400))
        touch("touchEnd")
        watch(page, 30)
        assert difference(still[0], picture(page)) > difference(*still) + 5.0


def test_the_first_start_on_a_machine_says_what_it_waits_for(tmp_path):
    nothing_compiled = {"NUMBA_CACHE_DIR": str(tmp_path / "numba")}
    with running_demo(tmp_path / "data", **nothing_compiled) as address, open_page() as page:
        page.goto(address)
        waiting = page.get_by_test_id("waiting")
        expect(waiting).to_contain_text("The server is starting up", timeout=MINUTES)
        page.get_by_test_id("start-join").click()
        expect(waiting).to_contain_text("The server is starting up")
        watch(page, 5, minutes=5.0)
        expect(waiting).to_have_count(0)


@contextmanager
def looking_into(data_dir: Path) -> Iterator[Services]:
    """The rows and objects of a demo that runs."""
    services = build_services(load_settings(data_dir=data_dir, open_access=True))
    try:
        yield services
    finally:
        services.close()


def stored(services: Services, person_id: str) -> set[str]:
    return {one.sha256 for one in services.objects.list(person_id)}


def the_film(services: Services) -> SequenceRow:
    """The only clip there is, whole, as it is trained from."""
    with services.reading() as unit:
        owners = services.objects.owners()
        (film,) = [film for owner in owners for film in unit.sequences.of_person(owner)]
    assert pictures_of(film) <= stored(services, film.person_id)
    return film


def pictures_of(film: SequenceRow) -> set[str | None]:
    return {film.source_sha256, film.packed_sha256, film.thumbnail_sha256}


def only_the_likeness_is_left(services: Services, film: SequenceRow) -> None:
    """Clip, frames and thumbnail go from the store; model and motion stay."""
    pictures = pictures_of(film)
    # the training goes on meanwhile, and gives way to live pictures
    until(lambda: not pictures & stored(services, film.person_id), "forgetting the clip", 300.0)
    with services.reading() as unit:
        assert unit.sequences.get(film.id).state is SequenceState.FORGOTTEN
        motion = unit.motions.of_sequence(film.id)
        assert motion is not None
        (model,) = unit.models.of_person(film.person_id)
        assert {motion.sha256, *(one.sha256 for one in model.files)} <= stored(
            services, film.person_id
        )
        previews = [job.preview for job in unit.jobs.of_sequence(film.id)]
        assert previews == [None] * len(previews)


def test_a_real_clip_becomes_somebody_in_the_meeting_and_only_their_likeness_is_kept(tmp_path):
    clip = short_clip(shared_data("real-two-cameras/cam01.mp4"), tmp_path / "clip.mp4", every=4)
    pose_model = str(landmark_model(POSE_MODEL))
    environment = {"METANERF_POSE_MODEL": pose_model}
    data = tmp_path / "data"
    with (
        running_demo(data, **environment) as address,
        looking_into(data) as services,
        open_page() as page,
    ):
        page.goto(address)
        page.route("**/v1/sequences/*/models", briefly)
        page.get_by_test_id("enrol-name").fill("Test person")
        page.get_by_test_id("enrol-height").fill("178")
        page.get_by_test_id("enrol-file").set_input_files(str(clip))
        page.get_by_test_id("enrol-model-only").check()
        page.get_by_test_id("enrol-submit").click()
        expect(page.get_by_test_id("progress")).to_be_visible(timeout=MINUTES)
        expect(page.get_by_test_id("quality")).to_be_visible(timeout=4 * MINUTES)
        expect(page.get_by_test_id("preview")).to_be_visible(timeout=2 * MINUTES)
        film = the_film(services)
        with services.reading() as unit:
            assert unit.people.get(film.person_id).height_m == 1.78
        meet = page.get_by_test_id("meet")
        expect(meet).to_be_visible(timeout=3 * MINUTES)
        meet.click()
        expect(page.get_by_test_id("live-video")).to_be_visible(timeout=MINUTES)
        only_the_likeness_is_left(services, film)
        watch(page, 30)
        before = picture(page)
        page.keyboard.down("d")
        watch(page, 15)
        page.keyboard.up("d")
        watch(page, 10)
        assert difference(before, picture(page)) > 3.0


def test_a_text_file_named_mp4_is_refused_in_words(tmp_path):
    fake = tmp_path / "holiday.mp4"
    fake.write_text("dear diary")
    with running_demo(tmp_path / "data") as address, open_page() as page:
        page.goto(address)
        page.get_by_test_id("enrol-name").fill("Nobody")
        page.get_by_test_id("enrol-file").set_input_files(str(fake))
        page.get_by_test_id("enrol-submit").click()
        error = page.get_by_test_id("error")
        expect(error).to_be_visible(timeout=MINUTES)
        expect(error).to_contain_text("video")


def test_keypoints_make_nobody_new_but_move_somebody_who_is_here(tmp_path):
    # one pose throughout, so that the picture stands still where they are followed
    still = tmp_path / "still.json"
    still.write_text(json.dumps(seeds.keypoints(30, angle=0.4)))
    with running_demo(tmp_path / "data") as address, open_page() as page:
        page.goto(f"{address}?size=256")  # one size throughout: a change of it would be seen
        page.get_by_test_id("enrol-name").fill("Nobody")
        page.get_by_test_id("enrol-file").set_input_files(str(still))
        expect(page.get_by_test_id("enrol-error")).to_contain_text("appearance comes from images")
        page.get_by_test_id("enrol-submit").click()
        expect(page.get_by_test_id("enrol-error")).to_contain_text("Choose a clip first")
        page.get_by_role("button", name="Keypoints", exact=True).click()
        page.get_by_test_id("keypoints-file").set_input_files(str(still))
        expect(page.get_by_test_id("keypoints-who")).to_contain_text("Ada")
        page.get_by_test_id("keypoints-submit").click()
        expect(page.get_by_test_id("live-video")).to_be_visible(timeout=MINUTES)
        expect(page.get_by_role("main")).to_contain_text("Ada by keypoints")
        watch(page, 40)
        pictures = [picture(page)]
        for _ in range(5):
            watch(page, 10)
            pictures.append(picture(page))
        assert np.frombuffer(pictures[0], np.uint8).std() > 10.0
        # by her own motion it is 1.5 or more; an encoder's key frame shows now and then
        changes = [difference(a, b) for a, b in itertools.pairwise(pictures)]
        assert np.median(changes) < 0.3
