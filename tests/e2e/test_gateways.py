"""Two gateways behind a balancer without memory: pages go where their meeting lives, and along."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import httpx
import pytest
from playwright.sync_api import Page, expect

from benchmarks.browser import open_page
from benchmarks.servers import MortalServer, gateway_at
from services.bootstrap import DEMO_MODEL, ensure_demo
from services.composition import build_services
from services.content_policy import CSP
from services.settings import load_settings
from tests.e2e.test_control import MINUTE, beside, come
from tests.e2e.test_meeting import watch
from tests.e2e.turns import turns
from tests.servers import free_port
from tests.services.jobs.waiting import until

pytestmark = pytest.mark.e2e


@dataclass(frozen=True)
class Gateways:
    """Both, and the address that they share."""

    common: str
    servers: dict[str, MortalServer]
    """By their own addresses."""
    meeting_id: str

    def home(self) -> str:
        """Where the meeting lives."""
        with httpx.Client(base_url=self.common) as caller:
            header = {"Authorization": f"Bearer {caller.post('/v1/guest').json()['token']}"}
            path = f"/v1/meetings/{self.meeting_id}/home"
            return caller.get(path, headers=header).json()["gateway_url"]


@pytest.fixture
def gateways(tmp_path: Path) -> Iterator[Gateways]:
    ports = [free_port() for _ in range(2)]
    with ExitStack() as stack:
        common = stack.enter_context(turns(ports)).address
        settings = load_settings(
            data_dir=tmp_path / "data", open_access=True, embedded_worker=False, public_url=common
        )
        services = build_services(settings)
        services.database.migrate()
        meeting_id = ensure_demo(services, DEMO_MODEL, "Ada")
        services.close()
        urls = [f"http://127.0.0.1:{port}" for port in ports]
        made = {url: gateway_at(url, settings.child_environment()) for url in urls}
        for one in made.values():
            stack.callback(one.kill)
            one.start()
        yield Gateways(common, made, meeting_id)


def test_two_people_meet_on_one_gateway_and_go_on_when_it_is_drained(gateways: Gateways):
    with open_page(512, 512) as ada, beside(ada, viewport={"width": 512, "height": 512}) as bo:
        people: dict[str, Page] = {"Ada": ada, "Bo": bo}
        for name, page in people.items():
            come(page, f"{gateways.common}/?size=128", name)
        for page in people.values():
            expect(page.get_by_test_id("live-video")).to_be_visible(timeout=MINUTE)
            page.get_by_test_id("render-mode").select_option("server", force=True)
            page.get_by_test_id("open-people").click()
            for name in people:
                expect(page.get_by_test_id("members")).to_contain_text(name, timeout=MINUTE)
            watch(page, 10)
        home = gateways.home()
        gateways.servers[home].end(within_s=60.0)
        assert gateways.home() != home
        for page in people.values():
            watch(page, 10)
            for name in people:
                expect(page.get_by_test_id("members")).to_contain_text(name)


def test_a_page_goes_on_at_a_gateway_that_came_after_it(gateways: Gateways):
    """Its policy names the gateways of its loading: to talk to another it loads itself anew."""
    (first, first_server), (later, later_server) = gateways.servers.items()
    until(lambda: later in httpx.get(first).headers[CSP], "the first sign of its life")
    later_server.kill()
    until(lambda: later not in httpx.get(first).headers[CSP], "the end of its lease")
    with open_page(512, 512) as careful:
        browser = careful.context.browser
        assert browser is not None
        page = browser.new_page(viewport={"width": 512, "height": 512})  # a violation is no fault
        come(page, f"{gateways.common}/?size=128", "Ada")
        expect(page.get_by_test_id("live-video")).to_be_visible(timeout=MINUTE)
        assert gateways.home() == first
        later_server.start()
        first_server.end(within_s=60.0)
        page.wait_for_function("() => sessionStorage.getItem('metanerf.reloaded')", timeout=MINUTE)
        expect(page.get_by_test_id("live-video")).to_be_visible(timeout=MINUTE)
        page.get_by_test_id("render-mode").select_option("server", force=True)
        watch(page, 10)
        page.get_by_test_id("open-people").click()
        expect(page.get_by_test_id("members")).to_contain_text("Ada (you)")
        assert gateways.home() == later
