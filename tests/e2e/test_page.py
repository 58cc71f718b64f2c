"""The page before joining, and on a television; axe looks on."""

from __future__ import annotations

import pytest
from playwright.sync_api import Page, expect

from benchmarks.browser import open_page
from services.live.packets import decode_view
from tests.e2e.serving import WATCH
from tests.e2e.test_control import MINUTE, beside, come, open_meeting, serious_faults
from tests.services.jobs.waiting import until

pytestmark = pytest.mark.e2e

# a camera and two microphones that hum; the machine that tests has none
_DEVICES = """
const device = (kind, id, label) => ({ kind, deviceId: id, label, groupId: "" });
navigator.mediaDevices.enumerateDevices = async () => [
  device("videoinput", "c1", "Desk camera"),
  device("audioinput", "m1", "Headset"), device("audioinput", "m2", "Table"),
];
navigator.mediaDevices.getUserMedia = async ({ audio, video }) => {
  window.asked = [...(window.asked ?? []), { audio, video }];
  if (video) {
    const canvas = document.createElement("canvas");
    canvas.getContext("2d").fillRect(0, 0, 9, 9);
    return canvas.captureStream(5);
  }
  const context = new AudioContext(), tone = context.createOscillator();
  const out = context.createMediaStreamDestination();
  tone.connect(out); tone.start();
  return out.stream;
};
"""
_REFUSED = """navigator.mediaDevices.getUserMedia =
  async () => { throw new DOMException("", "NotAllowedError"); }"""


def test_camera_and_microphone_are_tried_before_joining_and_remembered(demo):
    with open_page() as page:
        address = open_meeting(demo, page)
        page.add_init_script(_DEVICES)
        page.goto(address)
        expect(page.get_by_test_id("start-join")).to_be_visible(timeout=MINUTE)
        assert page.evaluate("window.asked") is None  # nothing is asked for before it is wanted
        check = page.get_by_test_id("device-check")
        check.locator("summary").click()
        page.wait_for_function(
            "() => document.querySelector('[data-testid=check-level]').value > 0.5", timeout=MINUTE
        )
        expect(page.get_by_test_id("check-camera")).to_be_visible()
        page.get_by_test_id("check-audioinput").select_option(label="Table")
        page.wait_for_function("() => asked.at(-1).audio?.deviceId?.ideal === 'm2'")
        page.get_by_test_id("join-unmuted").check()
        assert serious_faults(page) == []
        page.get_by_test_id("start-join").click()
        expect(page.get_by_test_id("microphone")).to_have_attribute(
            "aria-pressed", "true", timeout=MINUTE
        )
        assert page.evaluate("asked.at(-1).audio.deviceId.ideal") == "m2"
        page.get_by_test_id("leave").click()
        page.get_by_test_id("device-check").locator("summary").click()
        expect(page.get_by_test_id("join-unmuted")).to_be_checked()


def test_what_is_refused_is_explained_and_keeps_nobody_out(demo):
    with open_page(390, 844) as page:
        address = open_meeting(demo, page)
        page.add_init_script(_REFUSED)
        page.goto(address)
        page.get_by_test_id("device-check").locator("summary").click()
        microphone = page.get_by_test_id("problem-audioinput")
        expect(microphone).to_contain_text("The microphone is blocked. Allow it")
        expect(microphone).to_contain_text("You can join without")
        expect(page.get_by_test_id("problem-videoinput")).to_contain_text("The camera is blocked")
        assert serious_faults(page) == []
        page.get_by_test_id("start-join").click()
        expect(page.get_by_test_id("live-video")).to_be_visible(timeout=MINUTE)
        page.get_by_test_id("microphone").click()
        expect(page.locator(".previews")).to_contain_text("The microphone is blocked")


def position(page: Page) -> tuple[float, ...]:
    return tuple(decode_view(bytes(page.evaluate("lastView"))).position)


def test_a_television_is_steered_by_arrows_and_enter(demo):
    with (
        open_page() as desk,
        beside(
            desk,
            viewport={"width": 1920, "height": 1080},
            color_scheme="dark",
            reduced_motion="reduce",
        ) as page,
    ):
        address = open_meeting(demo, page)
        page.add_init_script(WATCH)
        come(page, address, "Ada")
        expect(page.get_by_test_id("live-video")).to_be_visible(timeout=MINUTE)
        page.wait_for_function("() => window.lastView", timeout=MINUTE)
        size = page.evaluate("parseFloat(getComputedStyle(document.documentElement).fontSize)")
        assert size >= 20
        viewport = page.get_by_role("main")
        viewport.focus()
        before = position(page)
        page.keyboard.down("ArrowUp")
        until(lambda: (page.wait_for_timeout(100), position(page) != before)[1], "a step")
        page.keyboard.up("ArrowUp")
        page.keyboard.press("Enter")
        expect(page.get_by_test_id("open-people")).to_be_focused()
        page.keyboard.press("ArrowRight")
        expect(page.get_by_test_id("open-chat")).to_be_focused()
        page.keyboard.press("ArrowUp")
        expect(page.get_by_test_id("open-chat")).not_to_be_focused()
        page.keyboard.press("Escape")
        expect(viewport).to_be_focused()
        page.keyboard.press("Enter")
        for _ in range(8):
            page.keyboard.press("ArrowRight")
            if page.evaluate("document.activeElement.dataset.testid") == "open-more":
                break
        page.keyboard.press("Enter")
        expect(page.get_by_test_id("environments")).to_be_visible()
        assert serious_faults(page) == []


_BE_SOMEBODY = """async () => {
  const headers = { Authorization: `Bearer ${localStorage.getItem("metanerf.token")}`,
                    "Content-Type": "application/json" };
  const body = JSON.stringify({ name: "Ada Example" });
  return (await fetch("/v1/people", { method: "POST", headers, body })).status;
}"""


def test_whoever_wants_to_be_forgotten_is_asked_once_more_and_gone(demo):
    with open_page() as page:
        page.goto(open_meeting(demo, page))
        expect(page.get_by_test_id("start-join")).to_be_visible(timeout=MINUTE)
        assert page.evaluate(_BE_SOMEBODY) == 201
        page.reload()
        mine = page.get_by_role("button", name="Erase me: Ada Example")
        mine.click()
        page.get_by_role("button", name="Keep").click()
        expect(mine).to_be_visible()
        mine.click()
        assert serious_faults(page) == []
        page.get_by_role("button", name="Erase everything").click()
        expect(page.get_by_test_id("privacy")).to_contain_text("Ada Example has been erased")
        expect(mine).to_have_count(0)
