"""Four pages in one meeting, from the lobby to seeing it again.

All are driven, each looks from elsewhere, all write; one talks and is muted, one loses the network
and comes back, the host changes the place, one is sent out; all of it is recorded and replayed.

The gateway is a process of its own: in the test's, where arrays are checked at each call, it would
be too slow for four viewers.
"""

from __future__ import annotations

import base64
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from benchmarks.browser import metric, open_page, running_demo
from db.models import ModelRow
from services.auth import ALL_SCOPES
from services.bootstrap import DEMO_MODEL, import_model
from services.container import Services
from services.live.keypoints_packet import encode_keypoints
from services.live.packets import decode_view
from services.meetings import create_meeting
from tests.e2e.serving import WATCH
from tests.e2e.test_control import HUM, LOUDNESS, beside
from tests.e2e.test_meeting import looking_into
from tests.e2e.test_replay import KEEP_PICTURES, RUNNING, difference, shown
from tests.e2e.viewport import frames_shown, picture
from tests.services.jobs.waiting import until
from tests.services.live.test_driving_channels import waving

pytestmark = pytest.mark.e2e
MINUTES = 60_000
NAMES = ("Ada", "Bo", "Cy", "Dee")

# recorded packets, over and over, numbered and dated anew
_DRIVE = """([performer, recorded]) => {
  const packets = recorded.map((text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)));
  const newest = { ordered: false, maxRetransmits: 0, protocol: performer };
  let channel = null, number = 0;
  setInterval(() => {
    // a connection that was made anew takes a new channel
    const gone = channel === null || channel.readyState === "closed";
    if (gone && viewPeer.connectionState === "connected") {
      channel = viewPeer.createDataChannel("keypoints", newest);
    }
    if (channel?.readyState !== "open") return;
    const packet = packets[number % packets.length], data = new DataView(packet.buffer);
    data.setUint32(4, ++number, true);
    data.setFloat64(8, performance.timeOrigin + performance.now(), true);
    channel.send(packet);
  }, 33);
}"""


@contextmanager
def four_pages(services: Services) -> Iterator[dict[str, Page]]:
    """Everybody's page, each with an account of their own."""
    with open_page(480, 400) as ada, ExitStack() as stack:
        pages = {"Ada": ada}
        for name in NAMES[1:]:
            pages[name] = stack.enter_context(beside(ada, viewport={"width": 480, "height": 400}))
        for name, page in pages.items():
            page.add_init_script(WATCH)
            token, _ = services.tokens.issue(name.lower(), ALL_SCOPES, timedelta(hours=1))
            page.add_init_script(f"sessionStorage.setItem('metanerf.token', '{token}')")
        pages["Bo"].add_init_script(HUM)
        yield pages


def everybody(services: Services) -> tuple[str, dict[str, str]]:
    """A meeting in which each of the four stands: its id, and performers by name."""
    models: list[ModelRow] = [
        import_model(services, DEMO_MODEL, name.lower(), name) for name in NAMES
    ]
    with services.unit_of_work() as unit:
        meeting = create_meeting(services, unit, "ada", "Monday", models)
        performers = {one.name: one.id for one in meeting.performers}
        unit.commit()
    return meeting.id, performers


def join(page: Page, address: str, name: str) -> None:
    page.goto(address)
    page.get_by_test_id("join-name").fill(name)
    page.get_by_test_id("start-join").click()


def open_panel(page: Page, which: str) -> None:
    """In so narrow a window one panel lies over the way to another."""
    page.get_by_test_id("panel-close").click()
    page.get_by_test_id(f"open-{which}").click()


def change(page: Page, first: bytes) -> float:
    """How far the page's picture is from an earlier one, mean of 0 to 255."""
    now, before = (np.frombuffer(one, np.uint8).astype(float) for one in (picture(page), first))
    return float(np.abs(now - before).mean())


def driven(address: str) -> float:
    """How many performers move by keypoints."""
    return metric(address, "metanerf_driven_performers")


def positions(pages: dict[str, Page]) -> np.ndarray:
    """Where each looks from, as their page last said, m."""
    packets = [bytes(page.evaluate("lastView")) for page in pages.values()]
    return np.array([decode_view(packet).position for packet in packets])


def everybody_moves(pages: dict[str, Page], address: str, performers: dict[str, str]) -> None:
    """Each by keypoints that their own page sends; every page shows pictures that move."""
    for page in pages.values():
        # a device that is quick enough draws by itself; here it is the server that draws for four
        page.get_by_test_id("render-mode").select_option("server", force=True)
    recorded = [base64.b64encode(encode_keypoints(one)).decode() for one in waving()]
    for name, page in pages.items():
        page.evaluate(_DRIVE, [performers[name], recorded])
    until(lambda: driven(address) == len(NAMES), "driving everybody")
    for name, page in pages.items():
        first = picture(page)
        until(lambda page=page, first=first: change(page, first) > 0.05, f"{name}'s picture moving")


def each_looks_from_elsewhere(pages: dict[str, Page]) -> None:
    """Everybody walks or turns their own way, and the server hears from four places."""
    before = positions(pages)
    for page, key in zip(pages.values(), "dawe", strict=True):
        page.get_by_role("main").focus()
        page.keyboard.down(key)

    def elsewhere() -> bool:
        now = positions(pages)
        apart = np.linalg.norm(now[:, None] - now[None], axis=2) + np.eye(4)
        return bool((np.linalg.norm(now - before, axis=1) > 0.1).all() and apart.min() > 0.05)

    until(elsewhere, "everybody's looking from elsewhere")
    for page, key in zip(pages.values(), "dawe", strict=True):
        page.keyboard.up(key)


def come_in(pages: dict[str, Page], address: str) -> None:
    """Three by the link, and Dee by Ada's leave."""
    ada, dee = pages["Ada"], pages["Dee"]
    for name in NAMES[:3]:
        join(pages[name], address, name)
        expect(pages[name].get_by_test_id("live-video")).to_be_visible(timeout=MINUTES)
    ada.get_by_test_id("open-people").click()
    # pictures come before the line does
    expect(ada.get_by_test_id("members").get_by_role("listitem")).to_have_count(3)
    ada.get_by_role("switch", name="Admit participants one at a time").check()
    join(dee, address, "Dee")
    expect(dee.get_by_test_id("lobby-waiting")).to_be_visible(timeout=MINUTES)
    ada.get_by_test_id("admit").click()
    expect(dee.get_by_test_id("live-video")).to_be_visible(timeout=MINUTES)
    ada.get_by_test_id("panel-close").click()


def all_write(pages: dict[str, Page]) -> None:
    for name, page in pages.items():
        page.get_by_test_id("open-chat").click()
        page.get_by_test_id("chat-text").fill(f"{name} is here")
        page.get_by_test_id("chat-send").click()
    for page in pages.values():
        for name in NAMES:
            expect(page.get_by_test_id("messages")).to_contain_text(f"{name} is here")
        page.get_by_test_id("panel-close").click()


def all_agree_to_a_recording(pages: dict[str, Page]) -> None:
    """It begins with the last yes."""
    pages["Ada"].get_by_test_id("record").click()
    for name in NAMES[1:]:
        expect(pages["Ada"].get_by_test_id("recording")).to_contain_text("once everybody agrees")
        pages[name].get_by_test_id("recording-agree").click()
    for page in pages.values():
        expect(page.get_by_test_id("recording")).to_have_text(RUNNING, timeout=MINUTES)


def the_host_mutes(pages: dict[str, Page]) -> None:
    """Bo is heard by the others until Ada mutes him."""
    bo, ada = pages["Bo"], pages["Ada"]
    others = [page for name, page in pages.items() if name != "Bo"]
    bo.get_by_test_id("microphone").click()
    for page in others:
        expect(page.get_by_test_id("active-speakers")).to_have_text("Bo", timeout=MINUTES)
        page.wait_for_function(f"() => ({LOUDNESS})() > 0.05", timeout=MINUTES)
    ada.get_by_test_id("open-people").click()
    ada.get_by_role("button", name="More about Bo").click()
    ada.get_by_role("button", name="Mute: Bo").click()
    expect(bo.get_by_test_id("microphone")).to_have_attribute("aria-pressed", "false")
    expect(bo.locator("#announcer")).to_contain_text("The host muted you")
    for page in others:
        expect(page.get_by_test_id("active-speakers")).to_be_hidden()
    ada.get_by_test_id("panel-close").click()


def one_loses_the_network_while_the_place_changes(pages: dict[str, Page], address: str) -> None:
    """Cy comes back on the same seat, is moved again, and sees where the others are meanwhile."""
    ada, cy = pages["Ada"], pages["Cy"]
    cy.get_by_test_id("hand").click()
    ada.get_by_test_id("open-people").click()
    members = ada.get_by_test_id("members")
    expect(members).to_contain_text("Hand raised")
    before = {name: picture(page) for name, page in pages.items()}
    # the browser's switch leaves WebRTC alone: that connection is cut by hand
    cy.context.set_offline(True)
    cy.evaluate("viewPeer.close()")
    open_panel(ada, "more")
    ada.get_by_test_id("environment-park").check()
    open_panel(ada, "people")
    expect(members).to_contain_text("Connection lost", timeout=MINUTES)
    seen = frames_shown(cy)
    cy.context.set_offline(False)
    expect(members).not_to_contain_text("Connection lost", timeout=MINUTES)
    expect(members.get_by_role("listitem")).to_have_count(4)
    expect(cy.get_by_test_id("hand")).to_have_attribute("aria-pressed", "true")
    until(lambda: frames_shown(cy) > seen, "pictures for Cy again")
    until(lambda: driven(address) == len(NAMES), "driving Cy again")
    for name, page in pages.items():
        first = before[name]
        until(lambda page=page, first=first: change(page, first) > 20.0, f"{name}'s new place")
    ada.get_by_test_id("panel-close").click()


def the_recording_ends(pages: dict[str, Page]) -> str:
    """By Bo's wish; the address by which Ada sees it again."""
    expect(pages["Ada"].get_by_test_id("recording")).to_have_text(RUNNING)
    pages["Bo"].get_by_test_id("recording-refuse").click()
    watch = pages["Ada"].get_by_role("link", name="Watch it")
    expect(watch).to_be_visible(timeout=MINUTES)
    return watch.get_attribute("href") or ""


def seen_again_from_elsewhere(page: Page, address: str) -> None:
    """What was recorded: all four, what they wrote, from one side and from another."""
    page.add_init_script(KEEP_PICTURES)
    page.goto(address)
    start = shown(page, 1)
    assert max(start) - min(start) > 60  # somebody stands there
    seek = page.get_by_test_id("replay-seek")
    seek.focus()
    seek.press("End")
    for name in NAMES:
        expect(page.get_by_test_id("replay-chat")).to_contain_text(f"{name} is here")
    # the place that was chosen last, and light from there
    until(lambda: difference(start, shown(page, 1)) > 20.0, "the place in the replay")
    moment = page.get_by_test_id("replay-clock").text_content()
    before = shown(page, 1)
    page.get_by_role("main").focus()
    page.keyboard.down("KeyE")
    until(lambda: difference(before, shown(page, 1)) > 5.0, "another viewpoint of the replay")
    page.keyboard.up("KeyE")
    assert page.get_by_test_id("replay-clock").text_content() == moment


def send_out_and_end(pages: dict[str, Page]) -> None:
    """Dee is sent out; for the others it ends."""
    ada, bo, dee = pages["Ada"], pages["Bo"], pages["Dee"]
    ada.get_by_test_id("open-people").click()
    ada.get_by_role("button", name="More about Dee").click()
    ada.get_by_role("button", name="Remove: Dee").click()
    expect(dee.get_by_test_id("goodbye-removed")).to_be_visible(timeout=MINUTES)
    expect(ada.get_by_test_id("members").get_by_role("listitem")).to_have_count(3)
    ada.get_by_test_id("end").click()
    ada.get_by_test_id("end-sure").click()
    expect(bo.get_by_test_id("goodbye-ended")).to_be_visible(timeout=MINUTES)


def test_four_meet(tmp_path: Path):
    data = tmp_path / "data"
    with (
        running_demo(data) as address,
        looking_into(data) as services,
        four_pages(services) as pages,
    ):
        meeting_id, performers = everybody(services)
        come_in(pages, f"{address}?meeting={meeting_id}&size=128")
        all_agree_to_a_recording(pages)
        everybody_moves(pages, address, performers)
        each_looks_from_elsewhere(pages)
        all_write(pages)
        the_host_mutes(pages)
        one_loses_the_network_while_the_place_changes(pages, address)
        recording = the_recording_ends(pages)
        send_out_and_end(pages)
        seen_again_from_elsewhere(pages["Ada"], f"{address.rstrip('/')}{recording}")
