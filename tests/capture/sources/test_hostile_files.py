"""Files of other people's tools are read or refused, whatever is in them, and run no code."""

from __future__ import annotations

import io
import pickle
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from capture.sources.bvh import parse_bvh
from capture.sources.readers.pickles import load_npy, load_pickle, numbers
from scene.errors import SceneError
from tests.few_examples import FEW, damaged

TABLE: dict[str, Any] = {
    "frame_000000": {
        "intrinsics": np.eye(3),
        "poses": np.zeros(72, np.float32),
        "names": ["a", "b"],
        "text": b"bytes",
        "number": np.float64(3.0),
    }
}
BVH = """HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Spine
  {
    OFFSET 0 10 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    End Site
    {
      OFFSET 0 5 0
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.0333
0 90 0 1 2 3 4 5 6
0 91 0 1 2 3 4 5 6
"""


def _array(value: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, value, allow_pickle=True)
    return file.getvalue()


def _read(name: str, data: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(data)
        with suppress(SceneError):
            (load_npy if name.endswith(".npy") else load_pickle)(path)


@FEW
@given(data=st.sampled_from([0, 2, 4, 5]).flatmap(lambda p: damaged(pickle.dumps(TABLE, p))))
def test_pickles(data: bytes):
    _read("a.pkl", data)


@FEW
@given(
    data=damaged(_array(np.arange(12.0).reshape(3, 4)))
    | damaged(_array(np.array([TABLE], dtype=object)))
    | st.binary(max_size=99)
)
def test_numpys_files(data: bytes):
    _read("a.npy", data)


@FEW
@given(data=damaged(BVH.encode()))
def test_motion_capture(data: bytes):
    with suppress(SceneError):
        parse_bvh(data.decode(errors="replace"))


def test_the_whole_ones_are_taken():
    clip = parse_bvh(BVH)
    assert clip.names == ("Hips", "Spine")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.pkl"
        path.write_bytes(pickle.dumps(TABLE))
        read = load_pickle(path)["frame_000000"]["intrinsics"]
        assert np.array_equal(numbers(read, (3, 3), "intrinsics"), np.eye(3))
