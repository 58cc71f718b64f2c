"""The frozen ruler: every file of it, and footage that it was not made for."""

from __future__ import annotations

import json

import numpy as np
import pytest

from benchmarks.real.cases import CASES
from benchmarks.real.ruler import RULERS, Ruler
from scene.errors import InvalidInput
from tests.shared_data import shared_data

NAMES = sorted(path.parent.name for path in RULERS.glob("*/ruler.json"))


@pytest.mark.parametrize("name", NAMES)
def test_masks_hold_one_person_and_points_lie_on_them(name):
    ruler = Ruler.read(name)
    assert list(ruler.indices) == sorted(set(ruler.indices))
    assert ruler.indices[-1] < ruler.clip_frames
    for index in ruler.indices:
        mask = ruler.mask(index)
        assert mask.shape == ruler.size[::-1]
        assert 0.01 < mask.mean() < 0.5
        assert (mask * ruler.hidden(index)).max() == 0.0
        rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
        face = ruler.face(index)
        if face is not None:
            assert columns[0] - 10 < face[:, 0].min() < face[:, 0].max() < columns[-1] + 10
            assert rows[0] - 10 < face[:, 1].min() < face[:, 1].max() < rows[-1] + 10
            inside = mask[tuple(face.astype(int).T[::-1])]
            assert (inside > 0.5).mean() > 0.9


def test_every_case_has_its_rulers():
    for case in CASES:
        for clip in (case.trained, *case.other_clips, *case.other_cameras):
            assert len(Ruler.read(clip).indices) >= 4, clip


def test_the_footage_is_that_of_the_ruler():
    footage = shared_data("real-webcam-people").parent
    for name in NAMES:
        ruler = Ruler.read(name)
        assert ruler.require_footage(footage).name == ruler.file.rsplit("/", 1)[-1]


def test_other_footage_is_refused(tmp_path):
    (tmp_path / "clip.mkv").write_bytes(b"other")
    folder = tmp_path / "clip"
    folder.mkdir()
    about = {
        "file": "clip.mkv",
        "sha256": "0" * 64,
        "size": [4, 4],
        "clip_frames": 2,
        "indices": [0],
    }
    (folder / "ruler.json").write_text(json.dumps(about))
    ruler = Ruler.read("clip", tmp_path)
    with pytest.raises(InvalidInput, match=r"clip that its ruler was made for.*fetch it again"):
        ruler.require_footage(tmp_path)
    with pytest.raises(InvalidInput, match="no file"):
        ruler.require_footage(tmp_path / "elsewhere")


def test_a_clip_without_a_ruler_is_refused():
    with pytest.raises(InvalidInput, match=r"must have a ruler; got 'nobody'; there are \["):
        Ruler.read("nobody")
