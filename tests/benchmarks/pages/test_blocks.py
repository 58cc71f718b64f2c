"""Pages show what docs/figures holds, and every file there says where it comes from."""

from __future__ import annotations

import json
import re
import shutil
from datetime import datetime, timedelta
from pathlib import Path

import pytest

from benchmarks.catalogue import CATALOGUE
from benchmarks.pages.blocks import BLOCKS, FIGURES, made_anew
from benchmarks.pages.provenance import measured_at
from benchmarks.reporting.checkout import ROOT

OF_A_CHANGED_TREE = {"distil", "local-view", "masks", "meeting", "performers", "relight", "serve"}
"""Measured before figures of a changed tree were refused; a name goes when it is measured anew."""


def files() -> dict[str, dict]:
    return {path.stem: json.loads(path.read_text()) for path in (ROOT / FIGURES).glob("*.json")}


def test_pages_show_the_committed_figures():
    outdated = [str(path) for path, text in made_anew(ROOT).items() if path.read_text() != text]
    assert not outdated, "run `metanerf bench pages`"


@pytest.mark.parametrize("name", sorted({block.sources[0] for block in BLOCKS}))
def test_another_commit_in_a_file_shows_on_its_page(tmp_path: Path, name: str):
    shutil.copytree(ROOT / FIGURES, tmp_path / FIGURES)
    for block in BLOCKS:
        page = tmp_path / block.page
        page.parent.mkdir(exist_ok=True)
        shutil.copyfile(ROOT / block.page, page)
    path = tmp_path / FIGURES / f"{name}.json"
    figures = path.read_text()
    commit = json.loads(figures)["commit"]
    path.write_text(figures.replace(f'"commit": "{commit}"', '"commit": "0123abc"'))
    changed = {path for path, text in made_anew(tmp_path).items() if path.read_text() != text}
    assert changed == {tmp_path / block.page for block in BLOCKS if name in block.sources}


@pytest.mark.parametrize("name", sorted(files()))
def test_a_committed_file_says_where_it_comes_from(name: str):
    figures = files()[name]
    assert figures["benchmark"] == name
    assert re.match(r"(metanerf )?bench [a-z]", figures["command"])
    assert re.fullmatch(r"[0-9a-f]{7,40}", figures["commit"])
    assert datetime.fromisoformat(figures["date"]).utcoffset() == timedelta(0)
    assert {"processor", "cores", "python", "torch"} <= set(figures["machine"])
    assert not figures["uncommitted_changes"] or name in OF_A_CHANGED_TREE


def test_every_file_is_some_benchmarks():
    assert set(files()) == {benchmark.name for benchmark in CATALOGUE}


def test_a_page_says_what_makes_an_origin_less_than_certain():
    clean = {
        "commit": "abcdef0",
        "date": "2026-05-01T12:00:00+00:00",
        "uncommitted_changes": False,
        "machine": {"processor": "a processor"},
    }
    assert measured_at(clean) == "Measured at `abcdef0` on 2026-05-01 (a processor)."
    old = {**clean, "uncommitted_changes": True, "date_from": "the date of its commit"}
    assert measured_at({**clean, "rows": [clean, old, clean]}) == (
        "Measured at `abcdef0` on 2026-05-01 (a processor) and `abcdef0` with uncommitted changes "
        "on 2026-05-01 (a processor, the date of its commit)."
    )
    rows = [{**clean, "machine": {**clean["machine"], "loop_ms": ms}} for ms in (12.5, 20, 11)]
    assert measured_at({**clean, "rows": rows}) == (
        "Measured at `abcdef0` on 2026-05-01 (a processor, reference loop 11 to 20 ms)."
    )


def test_rows_that_tell_nothing_are_of_the_commit_of_their_file():
    file = {
        "commit": "abcdef0",
        "date": "2026-05-01T12:00:00+00:00",
        "uncommitted_changes": False,
        "machine": {"processor": "a processor"},
    }
    later = {**file, "commit": "1234567", "date": "2026-05-02T12:00:00+00:00"}
    both = "`1234567` on 2026-05-02 (a processor) and `abcdef0` on 2026-05-01 (a processor)"
    assert measured_at({**file, "rows": [{"psnr": 30.0}, later]}) == f"Measured at {both}."
    alone = measured_at({**file, "rows": [later], "speed": [{"ms": 1.0}]})
    assert alone == "Measured at `1234567` on 2026-05-02 (a processor)."
