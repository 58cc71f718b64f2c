"""Keypoints alone: a motion in a small JSON file, that drives an existing model.

    {"format": "metanerf-keypoints", "version": 1, "layout": "smpl24", "frames_per_second": 30,
     "frames": [{"time_s": 0.0,
                 "joint_angles": [[x, y, z], ... 24 rows],   axis-angle, rad, joint to parent
                 "root_translation": [x, y, z]}, ...]}        m

    {"format": "metanerf-keypoints", "version": 1, "layout": "mediapipe33", "frames_per_second": 30,
     "frames": [{"time_s": 0.0,
                 "landmarks": [[x, y, z, visibility], ... 33 rows]}, ...]}

`smpl24`: joints by the names of `scene.skeleton`, T-pose at zero, y up, a person facing +z;
`root_translation` (default 0) is added to the pelvis' rest position. `mediapipe33`: MediaPipe's
world landmarks, m, origin between the hips, x right, y down, z away from the camera; visibility 0
to 1 (default 1). Without `time_s`, frames are 1 / `frames_per_second` apart.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from capture.body.inverse_kinematics import solve_pose
from capture.body.landmark_names import LANDMARK_COUNT
from capture.body.model import load_body_model
from capture.detection.landmark_arrays import joint_confidence
from capture.errors import BrokenKeypoints
from scene.arrays import Array
from scene.errors import SceneError
from scene.motion import Motion
from scene.skeleton import JOINT_COUNT, Skeleton

FORMAT, VERSION = "metanerf-keypoints", 1
LAYOUTS = ("smpl24", "mediapipe33")
MAX_BYTES = 256 * 2**20
MAX_FRAMES = 100_000


def read_keypoints(path: Path) -> Motion:
    """The motion in the keypoints file at `path`.

    Raises BrokenKeypoints with the rule, the value and its place.
    """
    if not path.is_file() or path.stat().st_size > MAX_BYTES:
        size = path.stat().st_size if path.is_file() else "no file"
        raise BrokenKeypoints(
            f"keypoints must be a file of at most {MAX_BYTES} bytes; got {size} at {path.name}"
        )
    try:
        data = json.loads(path.read_bytes())
    except (ValueError, RecursionError) as error:
        raise BrokenKeypoints(
            f"{path.name} must be JSON; got {error}; see docs/keypoints.md"
        ) from error
    return parse_keypoints(data)


def parse_keypoints(data: Any) -> Motion:
    """The motion in parsed JSON; see the module's text. Raises BrokenKeypoints."""
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        found = data.get("format") if isinstance(data, dict) else type(data).__name__
        raise BrokenKeypoints(f"format must be {FORMAT!r}; got {found!r}")
    if data.get("version") != VERSION:
        raise BrokenKeypoints(f"version must be {VERSION}; got {data.get('version')!r}")
    layout = data.get("layout")
    if layout not in LAYOUTS:
        raise BrokenKeypoints(f"layout must be one of {', '.join(LAYOUTS)}; got {layout!r}")
    rate = _number(data.get("frames_per_second", 30), "frames_per_second")
    if not 0.0 < rate <= 1000.0:
        raise BrokenKeypoints(f"frames_per_second must be above 0, at most 1000; got {rate!r}")
    frames = data.get("frames")
    if not isinstance(frames, list) or not 0 < len(frames) <= MAX_FRAMES:
        found = len(frames) if isinstance(frames, list) else type(frames).__name__
        raise BrokenKeypoints(f"frames must be a list of 1 to {MAX_FRAMES} entries; got {found}")
    times = np.array([_time(frame, index, rate) for index, frame in enumerate(frames)])
    try:
        return (_read_smpl if layout == "smpl24" else _read_mediapipe)(frames, times)
    except BrokenKeypoints:
        raise
    except SceneError as error:
        raise BrokenKeypoints(f"frames: {error}") from error


def _read_smpl(frames: list[Any], times: Array) -> Motion:
    angles = [_rows(f, i, "joint_angles", JOINT_COUNT, (3,)) for i, f in enumerate(frames)]
    roots = [_vector(f, i, "root_translation") for i, f in enumerate(frames)]
    trust = np.ones((len(frames), JOINT_COUNT))
    return Motion(times, np.array(angles), np.array(roots), trust)


def _read_mediapipe(frames: list[Any], times: Array) -> Motion:
    rows = np.array(
        [_rows(f, i, "landmarks", LANDMARK_COUNT, (3, 4)) for i, f in enumerate(frames)]
    )
    visibility = np.clip(rows[..., 3], 0.0, 1.0)
    angles = solve_pose(rows[..., :3], visibility)
    confidence = joint_confidence(visibility**2)
    return Motion(times, angles, _grounded_root(angles), confidence)


def _grounded_root(angles: Array) -> Array:
    """Root translations that keep the lowest joint where the lowest one is at rest.

    World landmarks have no place in the room: their origin is the hips.
    """
    skeleton = Skeleton(load_body_model().rest_joints)
    joints = skeleton.joint_transforms(angles, np.zeros((len(angles), 3)))[..., 1, 3]
    root = np.zeros((len(angles), 3))
    root[:, 1] = skeleton.rest_joints[:, 1].min() - joints.min(axis=1)
    return root


def _time(frame: Any, index: int, rate: float) -> float:
    if not isinstance(frame, dict):
        raise BrokenKeypoints(f"frames[{index}] must be an object; got {type(frame).__name__}")
    return _number(frame.get("time_s", index / rate), f"frames[{index}].time_s")


def _rows(frame: Any, index: int, key: str, count: int, widths: tuple[int, ...]) -> list[list]:
    rows, name = frame.get(key), f"frames[{index}].{key}"
    if not isinstance(rows, list) or len(rows) != count:
        found = len(rows) if isinstance(rows, list) else type(rows).__name__
        raise BrokenKeypoints(f"{name} must have {count} rows; got {found}")
    out = []
    for row_index, row in enumerate(rows):
        if not isinstance(row, list) or len(row) not in widths:
            found = len(row) if isinstance(row, list) else type(row).__name__
            wanted = " or ".join(map(str, widths))
            raise BrokenKeypoints(f"{name}[{row_index}] must have {wanted} numbers; got {found}")
        numbers = [_number(v, f"{name}[{row_index}][{i}]") for i, v in enumerate(row)]
        out.append(numbers + [1.0] * (widths[-1] - len(numbers)))
    return out


def _vector(frame: Any, index: int, key: str) -> list[float]:
    row, name = frame.get(key, [0.0, 0.0, 0.0]), f"frames[{index}].{key}"
    if not isinstance(row, list) or len(row) != 3:
        raise BrokenKeypoints(f"{name} must have 3 numbers; got {row!r}")
    return [_number(value, f"{name}[{i}]") for i, value in enumerate(row)]


def _number(value: Any, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise BrokenKeypoints(f"{name} must be a finite number; got {value!r}")
    return float(value)
