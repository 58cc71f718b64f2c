"""Pictures and videos of models say that they are synthetic, and show the same as without."""

from __future__ import annotations

import io
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from capture.overlay import write_video
from services.synthetic import NOTE, SOURCE_TYPE, mark_picture
from services.video import FRAMES_PER_SECOND, write_mp4, write_png
from services.views import encode

SIZE = (20, 30)


@pytest.mark.parametrize("kind", ["png", "jpeg", "webp"])
@pytest.mark.parametrize("background", [None, (0.2, 0.4, 0.6)])
def test_a_picture_says_it_and_shows_the_same(
    kind: str, background: tuple[float, float, float] | None
):
    rng = np.random.default_rng(0)
    rgba = rng.uniform(0.0, 1.0, (*SIZE, 4)).astype(np.float32)
    rgba[..., :3] *= rgba[..., 3:]
    data = encode(rgba, background, kind)
    assert SOURCE_TYPE.encode() in data
    assert NOTE.encode() in data
    shown = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    assert shown is not None
    has_alpha = background is None and kind != "jpeg"
    assert shown.shape == (*SIZE, 4 if has_alpha else 3)
    with av.open(io.BytesIO(data), "r") as container:  # another decoder, which is stricter
        assert next(container.decode(video=0)).width == SIZE[1]


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".webp"])
def test_pixels_stay_as_they_are(suffix: str):
    pixels = np.random.default_rng(1).integers(0, 255, (*SIZE, 3), dtype=np.uint8)
    plain = cv2.imencode(suffix, pixels)[1].tobytes()
    both = [plain, mark_picture(plain, SIZE[1], SIZE[0])]
    before, after = (cv2.imdecode(np.frombuffer(one, np.uint8), 1) for one in both)
    assert (before == after).all()


def test_files_of_the_command_line_say_it(tmp_path: Path):
    pictures = [np.full((64, 64, 3), 40 * i, np.uint8) for i in range(5)]
    write_png(tmp_path / "one.png", pictures[1])
    assert SOURCE_TYPE.encode() in (tmp_path / "one.png").read_bytes()
    write_mp4(tmp_path / "all.mp4", pictures)
    with av.open(str(tmp_path / "all.mp4")) as container:
        assert container.metadata["comment"] == NOTE
        assert container.metadata["description"] == SOURCE_TYPE
        assert sum(1 for _ in container.decode(video=0)) == 5
    assert {path.name for path in tmp_path.iterdir()} == {"one.png", "all.mp4"}


def test_a_marked_video_shows_the_same(tmp_path: Path):
    rng = np.random.default_rng(0)
    pictures = [rng.integers(0, 255, (64, 64, 3), np.uint8) for _ in range(6)]

    def frames(path: Path) -> list[np.ndarray]:
        with av.open(str(path)) as container:
            return [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]

    write_video(pictures, tmp_path / "plain.mp4", FRAMES_PER_SECOND)
    write_mp4(tmp_path / "marked.mp4", pictures)
    plain, marked = frames(tmp_path / "plain.mp4"), frames(tmp_path / "marked.mp4")
    assert len(plain) == 6
    assert all((a == b).all() for a, b in zip(plain, marked, strict=True))
