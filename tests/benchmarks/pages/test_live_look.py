"""The page's table of lifelike performers: shares of what is without live look."""

from __future__ import annotations

import json
from pathlib import Path

from benchmarks.lifelike_look.measure import BEHIND_DEG, BESIDE_DEG
from benchmarks.pages.live_look import live_look, local_look

_FIGURES = Path(__file__).parents[3] / "docs" / "figures"
FIGURES, PAGES = _FIGURES / "live-look.json", _FIGURES / "local-look.json"


def test_lifelike_performers_are_told_as_shares_of_what_is_without_it():
    figures = json.loads(FIGURES.read_text())
    model = {"body": 0.1, "part": 0.2, "flicker": 1.0}
    off = {"body": 0.2, "part": 0.3, "flicker": 5.0}
    live = {"body": 0.06, "part": 0.18, "flicker": 1.1}
    alone = {"off": off, "model": model}
    places = {f"{degrees:g}": {**alone, "live": live} for degrees in BESIDE_DEG}
    places |= {f"{degrees:g}": {**alone, "live": {"body": 0.1}} for degrees in BEHIND_DEG}
    places["135"] = {**alone, "live": {"body": 0.113}}
    cast = {"hazel": {"performances": {"hand across the chest": {"frames": 6, **places}}}}
    text = live_look({**figures, "lifelike": {"webcam_px": [640, 480], "cast": cast}})
    row = next(line for line in text.splitlines() if line.startswith("| hazel"))
    shares = ["0.30 (0.60) / 0.60"] * 4
    assert [cell.strip() for cell in row.split("|")[1:-1]] == [
        *("hazel", "hand across the chest", "0.200", *shares, "0.56 / 1.13"),
        "1.10 / 1.10 / 1.10",
    ]
    assert "0.6 from 10 degrees, 0.7 from 20 degrees, 0.85 from 40 degrees" in text


def test_what_a_senders_page_takes_is_told_where_it_was_measured():
    sender = {"landmarks_per_second": 20.2, "with_live_look": 17.9, "cores_for_live_look": 0.205}
    text = local_look({**json.loads(PAGES.read_text()), "sender": sender})
    assert "takes 0.20 of a core for it" in text
    assert "(18 a second, 20 without; limit 0.25, aim 0.12)" in text


def test_how_soon_it_is_gone_is_told_beside_the_limit():
    ends = [
        {"drawn_by": "page", "turns": 7, "told": 6, "median_ms": 62, "worst_ms": 181, "load": 3.5},
        {
            "drawn_by": "server",
            "turns": 7,
            "told": 0,
            "median_ms": None,
            "worst_ms": None,
            "load": 4.0,
        },
    ]
    lines = local_look({**json.loads(PAGES.read_text()), "gone": ends}).splitlines()
    page, server = (
        next(one for one in lines if f"| the {by} " in one) for by in ("page", "server")
    )
    assert [cell.strip() for cell in page.split("|")[2:-1]] == [
        *("62 ms", "181 ms", "200 ms", "6 of 7", "3.5")
    ]
    assert [cell.strip() for cell in server.split("|")[2:4]] == ["-", "-"]
