"""A neural field met live in a real browser: at preview size, in the same room as everybody."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import expect

from benchmarks.browser import open_page, running_demo
from services.auth import GUEST
from services.bootstrap import import_model
from services.composition import build_services
from services.meetings import create_meeting
from services.settings import load_settings
from tests.e2e.test_meeting import MINUTES, difference, watch
from tests.e2e.viewport import picture
from tests.services import seeds

pytestmark = pytest.mark.e2e

_BUDGET_S = 5
_TRAIN = """
import sys, time
from pathlib import Path
from capture.storage import open_sequence
from renderer.model_files import save_model
from renderer.training import train
clip = open_sequence(Path(sys.argv[1]))
model = train(clip, preset="fast", budget_s=float(sys.argv[3]), clock=time.perf_counter)
save_model(model, Path(sys.argv[2]))
"""


@pytest.fixture(scope="module")
def field(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A `fast` model of a few seconds, trained in a process of its own as jobs are."""
    folder = tmp_path_factory.mktemp("field")
    out = folder / "model.safetensors"
    arguments = [str(seeds.film(folder / "sequence")), str(out), str(_BUDGET_S)]
    subprocess.run([sys.executable, "-c", _TRAIN, *arguments], check=True)
    return out


def _meeting_with(model: Path, data_dir: Path) -> str:
    services = build_services(load_settings(data_dir=data_dir))
    services.database.migrate()
    row = import_model(services, model, GUEST, "Fay")
    with services.unit_of_work() as unit:
        meeting = create_meeting(services, unit, GUEST, "Fay's meeting", [row])
        unit.commit()
    services.close()
    return meeting.id


def test_a_field_moves_and_follows_the_viewer(tmp_path: Path, field: Path):
    meeting_id = _meeting_with(field, tmp_path / "data")
    with running_demo(tmp_path / "data") as address, open_page() as page:
        page.goto(f"{address}?meeting={meeting_id}&size=256")
        page.get_by_test_id("start-join").click()
        expect(page.get_by_test_id("live-video")).to_be_visible(timeout=MINUTES)
        expect(page.get_by_role("main")).to_contain_text("Fay's meeting")
        watch(page, 20)
        still = [picture(page)]
        assert _stands_out(still[0]) > 20.0
        watch(page, 20)
        still.append(picture(page))
        assert difference(*still) > 0.1
        page.mouse.move(512, 384)
        page.mouse.down()
        page.mouse.move(112, 384, steps=8)
        page.mouse.up()
        page.mouse.wheel(0, -600)
        watch(page, 20)
        assert difference(still[0], picture(page)) > difference(*still) + 3.0


def _stands_out(rgba: bytes) -> float:
    """How far the middle of a 64 x 64 picture differs from its left edge, in 8-bit steps."""
    rows = np.frombuffer(rgba, np.uint8).reshape(64, 64, 4).astype(float)[16:48]
    return float(np.abs(rows[:, 28:36].mean(axis=(0, 1)) - rows[:, :8].mean(axis=(0, 1))).max())
