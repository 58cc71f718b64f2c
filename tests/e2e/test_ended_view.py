"""A view that the server ends: the page makes a new one, and asks for nothing that is not there."""

from __future__ import annotations

from pathlib import Path

import pytest
from playwright.sync_api import Response, expect

from benchmarks.browser import open_page
from services.gateway import gateway_of
from tests.e2e.serving import serving
from tests.e2e.test_improving import MINUTE, enter
from tests.services.jobs.waiting import until

pytestmark = pytest.mark.e2e


def test_what_the_server_has_ended_the_page_may_end_again(tmp_path: Path):
    with serving(tmp_path / "data") as gateway, open_page() as page:
        answers: list[Response] = []
        page.on("response", lambda answer: answers.append(answer))
        enter(page, gateway)
        expect(page.get_by_test_id("live-video")).to_be_visible(timeout=MINUTE)
        page.wait_for_function(
            "() => document.querySelector('video').videoWidth > 0", timeout=MINUTE
        )
        views = gateway_of(gateway.app).views
        (offer,) = created(answers)
        gateway.do(views.close(offer.headers["location"].rpartition("/")[2]))
        until(lambda: (page.wait_for_timeout(100), len(created(answers)) == 2)[1], "a new view")
        deleted = [one.status for one in answers if one.request.method == "DELETE"]
        assert deleted == [204]
        assert [one.url for one in answers if one.status >= 400] == []


def created(answers: list[Response]) -> list[Response]:
    """Answers to offers of views."""
    return [one for one in answers if "/whep/" in one.url and one.request.method == "POST"]
