"""Two real pages in one meeting: one is let in, they talk, one is sent out; axe looks on."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest
from playwright.sync_api import Page, expect

from benchmarks.browser import faults_of, open_page

pytestmark = pytest.mark.e2e
MINUTE = 60_000
AXE = Path(__file__).resolve().parents[2] / "client/node_modules/axe-core/axe.min.js"
_SERIOUS = """async () => (await axe.run()).violations
    .filter(({impact}) => impact === 'serious' || impact === 'critical')
    .map(({id, nodes}) => `${id}: ${nodes.map(({html}) => html.slice(0, 120)).join(' | ')}`)"""


@contextmanager
def beside(page: Page, **look) -> Iterator[Page]:
    """A page of somebody else, in the same browser, which must not fail (faults_of)."""
    browser = page.context.browser
    assert browser is not None
    context = browser.new_context(**look)
    other = context.new_page()
    faults = faults_of(other)
    yield other
    context.close()
    assert faults == []


def serious_faults(page: Page) -> list[str]:
    """What axe finds on the page that keeps people out."""
    if not page.evaluate("'axe' in window"):
        page.evaluate(AXE.read_text())  # the page itself lets no foreign script in
    return page.evaluate(_SERIOUS)


def open_meeting(demo: str, host: Page) -> str:
    """The address of a new, empty meeting; the page `host` is its host as soon as it comes."""
    with httpx.Client(base_url=demo) as caller:
        token = caller.post("/v1/guest").json()["token"]
        header = {"Authorization": f"Bearer {token}"}
        opened = caller.post("/v1/meetings", json={"name": "Monday"}, headers=header).json()
    host.add_init_script(
        f"sessionStorage.setItem('metanerf.host.{opened['id']}', '{opened['host_token']}')"
    )
    return f"{demo}?meeting={opened['id']}&size=128"


def come(page: Page, address: str, name: str) -> None:
    page.goto(address)
    page.get_by_test_id("join-name").fill(name)
    page.get_by_test_id("start-join").click()


def test_a_meeting_of_two_from_the_lobby_to_being_sent_out(demo):
    phone = {"viewport": {"width": 390, "height": 844}, "color_scheme": "dark"}
    with open_page() as ada, beside(ada, **phone) as bo:
        address = open_meeting(demo, ada)
        ada.goto(address)
        assert serious_faults(ada) == []
        come(ada, address, "Ada")
        ada.get_by_test_id("open-people").click()
        expect(ada.get_by_test_id("members")).to_contain_text("Ada (you)", timeout=MINUTE)
        ada.get_by_role("switch", name="Admit participants one at a time").check()
        expect(ada.get_by_role("switch")).to_be_checked()

        come(bo, address, "Bo")
        expect(bo.get_by_test_id("lobby-waiting")).to_be_visible()
        assert bo.locator("video").count() == 0
        assert serious_faults(bo) == []
        expect(ada.get_by_test_id("waiting-people")).to_contain_text("Bo")
        assert serious_faults(ada) == []
        ada.get_by_test_id("admit").click()
        expect(bo.get_by_test_id("live-video")).to_be_visible(timeout=MINUTE)
        expect(ada.locator("#announcer")).to_contain_text("Bo joined")

        bo.get_by_test_id("hand").click()
        expect(bo.get_by_test_id("hand")).to_have_attribute("aria-pressed", "true")
        expect(ada.get_by_test_id("members")).to_contain_text("Hand raised")
        bo.get_by_test_id("react").click()
        bo.get_by_test_id("react-heart").click()
        expect(ada.locator(".reaction-shown")).to_contain_text("Bo")
        assert serious_faults(ada) == []

        ada.get_by_test_id("open-chat").click()
        ada.get_by_test_id("chat-text").fill("<b>Hello</b> Bo")
        ada.keyboard.press("Enter")
        bo.get_by_test_id("open-chat").click()
        expect(bo.get_by_test_id("messages")).to_contain_text("<b>Hello</b> Bo")
        bo.get_by_test_id("chat-text").fill("Hello Ada")
        bo.get_by_test_id("chat-send").click()
        expect(ada.get_by_test_id("messages")).to_contain_text("Hello Ada")
        assert serious_faults(bo) == []

        # the same seat after a reload: the hand is still up, what was said is still there
        bo.reload()
        expect(bo.get_by_test_id("live-video")).to_be_visible(timeout=MINUTE)
        expect(bo.get_by_test_id("hand")).to_have_attribute("aria-pressed", "true")
        bo.get_by_test_id("open-chat").click()
        expect(bo.get_by_test_id("messages")).to_contain_text("Hello Ada")
        ada.get_by_test_id("open-people").click()
        expect(ada.get_by_test_id("members").get_by_role("listitem")).to_have_count(2)

        ada.get_by_role("button", name="More about Bo").click()
        ada.get_by_role("button", name="Remove: Bo").click()
        expect(bo.get_by_test_id("goodbye-removed")).to_be_visible()
        assert bo.locator("video").count() == 0
        assert serious_faults(bo) == []
        expect(ada.get_by_test_id("members").get_by_role("listitem")).to_have_count(1)


def test_everything_is_reached_by_keyboard_in_a_sensible_order(demo):
    with open_page() as page:
        page.goto(open_meeting(demo, page))
        page.get_by_test_id("join-name").focus()
        page.keyboard.type("Ada")
        page.keyboard.press("Enter")
        expect(page.get_by_test_id("live-video")).to_be_visible(timeout=MINUTE)
        # what is said before the control channel has let somebody in is not sent
        expect(page.get_by_test_id("open-people")).to_contain_text("1 here", timeout=MINUTE)
        focused = "() => document.activeElement.dataset.testid ?? ''"
        met = []
        for _ in range(20):
            page.keyboard.press("Tab")
            met.append(page.evaluate(focused))
            if met[-1] == "react":
                break
        ways = ["leave", "open-people", "open-chat", "microphone", "hand", "react"]
        assert [one for one in met if one in ways] == ways
        for _ in range(3):
            page.keyboard.press("Shift+Tab")
        page.keyboard.press("Enter")
        assert page.evaluate(focused) == "chat-text"
        page.keyboard.type("was dead")
        page.keyboard.press("Enter")
        expect(page.get_by_test_id("messages")).to_contain_text("was dead")
        page.keyboard.press("Escape")
        expect(page.get_by_test_id("panel")).to_be_hidden()
        assert page.evaluate(focused) == "open-chat"
        page.get_by_test_id("open-people").press("Enter")
        page.get_by_test_id("end").press("Enter")
        assert page.evaluate(focused) == "end-sure"
        page.keyboard.press("Enter")
        expect(page.get_by_test_id("goodbye-ended")).to_be_visible()


# a microphone that hums: the machine that tests has none
HUM = """navigator.mediaDevices.getUserMedia = async () => {
    const context = new AudioContext(), tone = context.createOscillator();
    const out = context.createMediaStreamDestination();
    tone.connect(out);
    tone.start();
    return out.stream;
}"""
LOUDNESS = """() => {
    const audio = document.querySelector('[data-testid=remote-audio]');
    if (!audio.srcObject) return 0;
    if (!window.meter) {
        const context = new AudioContext();
        window.meter = context.createAnalyser();
        context.createMediaStreamSource(audio.srcObject).connect(window.meter);
    }
    const samples = new Float32Array(window.meter.fftSize);
    window.meter.getFloatTimeDomainData(samples);
    return Math.max(...samples.map(Math.abs));
}"""


def test_a_voice_is_heard_until_the_host_mutes_it(demo):
    with open_page() as ada, beside(ada) as bo:
        address = open_meeting(demo, ada)
        bo.add_init_script(HUM)
        come(ada, address, "Ada")
        expect(ada.get_by_test_id("live-video")).to_be_visible(timeout=MINUTE)
        come(bo, address, "Bo")
        expect(bo.get_by_test_id("live-video")).to_be_visible(timeout=MINUTE)
        ada.wait_for_function(f"() => ({LOUDNESS})() === 0")
        bo.get_by_test_id("microphone").click()
        expect(bo.get_by_test_id("microphone")).to_have_attribute("aria-pressed", "true")
        expect(ada.get_by_test_id("active-speakers")).to_have_text("Bo", timeout=MINUTE)
        ada.wait_for_function(f"() => ({LOUDNESS})() > 0.05", timeout=MINUTE)
        ada.get_by_test_id("open-people").click()
        ada.get_by_role("button", name="More about Bo").click()
        ada.get_by_role("button", name="Mute: Bo").click()
        expect(bo.get_by_test_id("microphone")).to_have_attribute("aria-pressed", "false")
        expect(bo.locator("#announcer")).to_contain_text("The host muted you")
        expect(ada.get_by_test_id("active-speakers")).to_be_hidden()
        # held down for a moment, the space bar opens it again
        bo.get_by_role("main").focus()
        bo.keyboard.down("Space")
        expect(ada.get_by_test_id("active-speakers")).to_have_text("Bo")
        bo.keyboard.up("Space")
        expect(bo.get_by_test_id("microphone")).to_have_attribute("aria-pressed", "false")
        expect(ada.get_by_test_id("active-speakers")).to_be_hidden()
