"""Two people with a likeness each meet by a link: who was invited is seen as themselves."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import httpx
import numpy as np
import pytest
from playwright.sync_api import Page, expect

from benchmarks.browser import open_page
from capture.detection.network_files import FACE_MODEL, HAND_MODEL, POSE_MODEL
from services.bootstrap import DEMO_MODEL, import_model
from services.meetings import create_meeting
from tests.e2e.serving import Gateway, serving
from tests.e2e.test_control import beside
from tests.e2e.test_motion_capture import webcam
from tests.e2e.test_sealed import MINUTES, SIZE, seen
from tests.landmark_models import landmark_model
from tests.services.jobs.waiting import until
from tests.shared_data import shared_data

pytestmark = pytest.mark.e2e


@dataclass(frozen=True)
class Meeting:
    """Ada's, on a running server, to which Bo has a link."""

    gateway: Gateway
    id: str

    @property
    def address(self) -> str:
        return f"{self.gateway.address}?meeting={self.id}&size=256"

    def shown(self) -> list[str]:
        """Names of who stands there, as Ada is told."""
        headers = {"Authorization": f"Bearer {self.gateway.token('ada')}"}
        address = f"{self.gateway.address.rstrip('/')}/v1/meetings/{self.id}"
        return [one["name"] for one in httpx.get(address, headers=headers).json()["performers"]]


@pytest.fixture
def meeting(tmp_path: Path) -> Iterator[Meeting]:
    networks = {
        "pose_model": landmark_model(POSE_MODEL),
        "face_model": landmark_model(FACE_MODEL),
        "hand_model": landmark_model(HAND_MODEL),
    }
    with serving(tmp_path / "data", **networks) as gateway:
        services = gateway.services
        ada = import_model(services, DEMO_MODEL, "ada", "Ada")
        import_model(services, DEMO_MODEL, "bo", "Bo")
        with services.unit_of_work() as unit:
            made = create_meeting(services, unit, "ada", "Monday", [ada])
            unit.commit()
        yield Meeting(gateway, made.id)


def known_as(page: Page, meeting: Meeting, account: str) -> None:
    token = meeting.gateway.token(account)
    page.add_init_script(f"sessionStorage.setItem('metanerf.token', '{token}')")


def join(page: Page, address: str, name: str) -> None:
    page.goto(address)
    page.get_by_test_id("join-name").fill(name)
    page.get_by_test_id("start-join").click()
    expect(page.get_by_test_id("live-video")).to_be_visible(timeout=MINUTES)


def apart(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.abs(one - other).mean())


def test_whoever_comes_by_a_link_stands_there_as_themselves_until_they_leave(
    meeting: Meeting, tmp_path: Path
):
    film = webcam(
        shared_data("real-monocular/webcam_upperbody_woman_asl.mp4"), tmp_path / "webcam.mjpeg"
    )
    with open_page(**SIZE, webcam=film) as ada, beside(ada, viewport=SIZE) as bo:
        for page, account in ((ada, "ada"), (bo, "bo")):
            known_as(page, meeting, account)
            join(page, meeting.address, account.title())
        assert meeting.shown() == ["Ada"]
        alone = seen(ada)
        bo.get_by_test_id("motion-capture").click()
        expect(bo.get_by_test_id("self")).to_contain_text("Animating Bo.", timeout=MINUTES)
        until(lambda: meeting.shown() == ["Ada", "Bo"], "Bo's coming")
        expect(bo.get_by_test_id("self")).to_have_attribute(
            "data-tracking", "tracking", timeout=MINUTES
        )
        until(lambda: ada.wait_for_timeout(500) or apart(seen(ada), alone) > 4.0, "Ada's seeing Bo")
        bo.get_by_test_id("leave").click()
        until(lambda: meeting.shown() == ["Ada"], "Bo's going")
