"""Consent and invitations on the page: who revokes vanishes at once, and a host renews the link."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import pytest
from playwright.sync_api import Dialog, Page, expect

from benchmarks.browser import open_page
from services.bootstrap import DEMO_MODEL, import_model
from services.meetings import create_meeting
from tests.e2e.serving import Gateway, serving
from tests.e2e.test_control import beside, serious_faults
from tests.e2e.test_four_people import join
from tests.e2e.test_local_view import draw_here, seen
from tests.e2e.test_meeting import MINUTES, watch

pytestmark = pytest.mark.e2e
AT_ONCE = 2_500
"""ms; the server takes one at most, and this machine draws for two pages meanwhile."""


@dataclass
class Met:
    """Ada, who hosts, and Bo: both stand in the meeting, and each has a page."""

    gateway: Gateway
    address: str
    ada: Page
    bo: Page


@contextmanager
def met(tmp_path) -> Iterator[Met]:
    with serving(tmp_path / "data") as gateway:
        services = gateway.services
        models = [import_model(services, DEMO_MODEL, name.lower(), name) for name in ("Ada", "Bo")]
        with services.unit_of_work() as unit:
            meeting = create_meeting(services, unit, "ada", "Monday", models)
            unit.commit()
        address = f"{gateway.address}?meeting={meeting.id}&size=256"
        with open_page() as ada, beside(ada) as bo:
            for page, name in ((ada, "Ada"), (bo, "Bo")):
                token = gateway.token(name.lower())
                page.add_init_script(f"sessionStorage.setItem('metanerf.token', '{token}')")
                join(page, address, name)
                watch(page, 2)
            yield Met(gateway, address, ada, bo)


def revoke(page: Page) -> None:
    page.get_by_test_id("consent-revoke").click()
    expect(page.get_by_test_id("consent")).to_contain_text("disappears at once from meetings")
    page.get_by_test_id("consent-revoke-sure").click()
    expect(page.get_by_test_id("consent-state")).to_contain_text("the model is shown nowhere")


def test_who_revokes_vanishes_from_a_page_that_draws_by_itself(tmp_path):
    with met(tmp_path) as here:
        ada, bo = here.ada, here.bo
        draw_here(bo)
        shown = bo.locator(".performers button")
        expect(shown).to_have_count(2)
        watch(bo, 5)
        both = seen(bo)
        ada.get_by_test_id("open-more").click()
        expect(ada.get_by_test_id("consent-state")).to_have_text(
            "Consent given for meetings, recordings; no end is set."
        )
        assert serious_faults(ada) == []
        revoke(ada)
        expect(shown).to_have_count(1, timeout=AT_ONCE)
        expect(bo.locator(".notifications")).to_contain_text("Ada is no longer shown")
        expect(ada.locator(".notifications")).to_contain_text("You are no longer shown")
        watch(bo, 5)
        assert np.abs(seen(bo) - both).mean() > 1.0

        # the last one goes too: the page empties the room, and the server draws what is left
        bo.get_by_test_id("open-more").click()
        revoke(bo)
        expect(shown).to_have_count(0, timeout=AT_ONCE)
        expect(bo.locator(".viewport > canvas.shown")).to_have_count(0, timeout=MINUTES)
        watch(bo, 5)

        ada.get_by_test_id("consent-change").click()
        ada.get_by_label("Keep it in recordings").uncheck()
        ada.get_by_test_id("consent-save").click()
        expect(ada.get_by_test_id("consent-state")).to_have_text(
            "Consent given for meetings; no end is set."
        )
        expect(shown).to_have_count(1, timeout=AT_ONCE)
        watch(bo, 5)


def test_a_host_renews_the_invitation_and_whoever_is_in_stays(tmp_path):
    with met(tmp_path) as here:
        ada, bo = here.ada, here.bo
        ada.get_by_test_id("open-people").click()
        ada.get_by_test_id("renew-invitation").click()
        people = ada.get_by_test_id("members").locator("..")
        expect(people).to_contain_text("The link that was sent so far stops working")
        expect(people).to_contain_text("Whoever is in the meeting stays in it.")
        assert serious_faults(ada) == []
        ada.get_by_test_id("renew-invitation-sure").click()
        expect(ada.get_by_test_id("invitation-told")).to_contain_text("no longer works")
        watch(bo, 10)  # who is in stays in
        with beside(ada) as cy:
            cy.goto(here.address)
            expect(cy.get_by_test_id("error")).to_contain_text("newest invitation", timeout=MINUTES)
        copied: list[str] = []

        def keep(dialog: Dialog) -> None:
            copied.append(dialog.default_value)
            dialog.dismiss()

        ada.on("dialog", keep)
        ada.evaluate("() => { navigator.clipboard.writeText = () => Promise.reject(); }")
        ada.get_by_role("button", name="Copy invite link").click()
        (link,) = copied
        with beside(ada) as dee:
            join(dee, link, "Dee")
            expect(dee.get_by_test_id("live-video")).to_be_visible(timeout=MINUTES)
            expect(ada.get_by_test_id("members")).to_contain_text("Dee", timeout=MINUTES)
