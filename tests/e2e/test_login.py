"""Signing in at a real provider in a real browser: there, back to a meeting, and out."""

from __future__ import annotations

from pathlib import Path

import pytest
from playwright.sync_api import expect

from benchmarks.browser import open_page
from services.bootstrap import DEMO_MODEL, import_model
from services.identity_provider import account_of
from tests.e2e.serving import serving
from tests.e2e.test_control import serious_faults
from tests.services.openid_provider import CLIENT_ID, CLIENT_SECRET, running_provider

pytestmark = pytest.mark.e2e
MINUTES = 60_000
KEPT = "Object.keys(localStorage).filter((key) => key.startsWith('metanerf.'))"


def test_one_signs_in_makes_a_meeting_and_signs_out(tmp_path: Path):
    with (
        running_provider() as provider,
        serving(
            tmp_path / "data",
            open_access=False,
            oidc_issuer=provider.issuer,
            oidc_client_id=CLIENT_ID,
            oidc_client_secret=CLIENT_SECRET,
        ) as gateway,
        open_page() as page,
    ):
        import_model(gateway.services, DEMO_MODEL, account_of(provider.issuer, "1002"), "Bo")
        addresses: list[str] = []
        page.on("request", lambda asked: addresses.append(asked.url))
        page.goto(gateway.address)
        expect(page.get_by_role("heading", name="Sign in to meet")).to_be_visible()
        assert serious_faults(page) == []
        page.get_by_test_id("sign-in-here").click()
        page.get_by_text("Not at all").click()
        expect(page.get_by_test_id("error")).to_contain_text("You were not signed in")
        page.get_by_test_id("sign-in-here").click()
        page.get_by_text("As Bo").click()
        # the name is text, whatever is in it
        expect(page.locator(".account-name")).to_have_text("Bo <b>&")
        assert page.url == gateway.address
        assert serious_faults(page) == []
        for width in (1280, 360):
            page.set_viewport_size({"width": width, "height": 800})
            page.screenshot(path=tmp_path / f"signed-in-{width}.png")
            fits = "document.documentElement.scrollWidth <= innerWidth"
            assert page.evaluate(fits), width
        page.set_viewport_size({"width": 1280, "height": 800})

        token = page.evaluate("localStorage.getItem('metanerf.token')")
        form = page.get_by_test_id("seal")
        form.locator("summary").click()
        expect(page.get_by_test_id("sealed-who").locator("option").first).to_have_text("Bo")
        page.get_by_test_id("sealed-open").click()
        expect(page.locator(".viewport > canvas.shown")).to_be_visible(timeout=MINUTES)
        page.get_by_test_id("leave").click()
        page.get_by_test_id("sign-out").click()
        expect(page.get_by_role("heading", name="Sign in to meet")).to_be_visible()
        assert "/logout" in provider.asked
        assert page.evaluate(KEPT) == []
        assert not [one for one in addresses if token in one]
