"""Sequence folders: one person's frames on disk. Reading is lazy, writing is all or nothing.

sequence.json            version, person, frames_per_second, split, source, pose_trust, quality
cameras.npz              intrinsics [N 3 3] px, world_to_camera [N 3 4] m, size (width, height) or,
                         where frames differ, [N 2], optional distortion [N 5]
motion.npz               times_s, joint_angles (axis-angle, rad), root_translation, confidence
                         and, where anybody moved their face or fingers, expressions
body.npz                 rest_joints and, where known, rest_vertices, faces, blend_weights,
                         expression_directions
images/000000.png        sRGB, 8 bit          masks/000000.png      alpha, 8 bit
test/novel_view/, test/unseen_pose/           cameras.npz, motion.npz, images/, masks/
"""

from __future__ import annotations

import hashlib
import json
import math
import shutil
import struct
import tempfile
import tokenize
import zipfile
import zlib
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from capture.errors import BrokenSequence
from scene.arrays import Array, Float
from scene.body import Body
from scene.camera import Camera
from scene.errors import SceneError
from scene.expression import offsets_of_any_version, values_of_any_version
from scene.motion import Motion, Pose
from scene.sequence import NOVEL_VIEW, UNSEEN_POSE, Crop, Frame, PoseTrust, Sequence, crop_window
from scene.skeleton import Skeleton

VERSION = 1
_TEST_SPLITS = (NOVEL_VIEW, UNSEEN_POSE)
_NO_ARRAYS = (
    *(OSError, ValueError, EOFError, MemoryError, SyntaxError, zipfile.BadZipFile, zlib.error),
    *(NotImplementedError, RuntimeError, struct.error, tokenize.TokenError),
)
"""What NumPy and zipfile raise for archives that are broken, encrypted or packed otherwise."""
_MOST_UNPACKED_BYTES = 512 << 20
"""Of a file's arrays: a body with all its blend shapes takes 20 MB, and nothing would be gained by
more than memory holds."""


@dataclass(frozen=True, eq=False)
class FolderFrames:
    """Frames of one split, read from disk when asked for (a `CropSource`)."""

    folder: Path
    cameras: tuple[Camera, ...]
    motion: Motion

    def __len__(self) -> int:
        return len(self.cameras)

    def camera(self, index: int) -> Camera:
        """The camera of frame `index`."""
        return self.cameras[index]

    def pose(self, index: int) -> Pose:
        """The pose of frame `index`."""
        return self.motion.pose(index)

    def image(self, index: int) -> Float[Array, "H W 3"]:
        """float32 sRGB in [0, 1]. Raises BrokenSequence for a file that is no picture."""
        pixels = self._read("images", index, cv2.IMREAD_COLOR)
        return pixels[..., ::-1].astype(np.float32) / np.float32(255.0)

    def mask(self, index: int) -> Float[Array, "H W"]:
        """float32 alpha in [0, 1]. Raises BrokenSequence for a file that is no picture."""
        pixels = self._read("masks", index, cv2.IMREAD_GRAYSCALE)
        return pixels.astype(np.float32) / np.float32(255.0)

    def crop(self, index: int, margin: float) -> Crop:
        """See `scene.sequence.CropSource`. Raises BrokenSequence for a file that is no picture."""
        alpha = self._read("masks", index, cv2.IMREAD_GRAYSCALE)
        rows, columns = crop_window(alpha, margin)
        pixels = self._read("images", index, cv2.IMREAD_COLOR)[rows, columns, ::-1]
        return Crop(np.dstack([pixels, alpha[rows, columns]]), rows, columns)

    def _read(self, kind: str, index: int, mode: int) -> Array:
        path = self.folder / kind / f"{index:06d}.png"
        pixels = cv2.imread(str(path), mode) if path.exists() else None
        camera = self.cameras[index]
        if pixels is None:
            size = path.stat().st_size if path.exists() else "no file"
            raise BrokenSequence(
                f"{kind}/{path.name} must be a picture; got {size} bytes; write it again"
            )
        if pixels.shape[:2] != (camera.height, camera.width):
            raise BrokenSequence(
                f"{kind}/{path.name} must be as large as its camera "
                f"({camera.width} x {camera.height}); got {pixels.shape[1]} x {pixels.shape[0]}"
            )
        return pixels


def open_sequence(path: Path) -> Sequence:
    """The sequence in folder `path`; pictures are read later, one by one.

    Raises BrokenSequence naming the file and the rule it breaks.
    """
    about = _read_json(path / "sequence.json")
    if about.get("version") != VERSION:
        raise BrokenSequence(
            f"sequence.json must be version {VERSION}; got {about.get('version')!r}; capture again"
        )
    rate = about.get("frames_per_second", 30.0)
    if not (isinstance(rate, int | float) and 0.0 < rate < math.inf):
        raise BrokenSequence(
            f"frames_per_second in sequence.json must be a positive number; got {rate!r}"
        )
    train = _open_frames(path)
    test = {
        s: _open_frames(path / "test" / s) for s in _TEST_SPLITS if (path / "test" / s).is_dir()
    }
    return Sequence(
        person=str(about.get("person", "")),
        frames_per_second=float(rate),
        body=_read_body(path / "body.npz"),
        train=train,
        data_hash=_data_hash(path),
        motion=train.motion,
        test=test,
        pose_trust=_pose_trust(about),
    )


def _pose_trust(about: Mapping[str, Any]) -> PoseTrust:
    """Sequences of earlier versions say `exact_poses`, true or false."""
    before = PoseTrust.EXACT if about.get("exact_poses") else PoseTrust.ESTIMATED
    stored = about.get("pose_trust", before)
    if stored not in list(PoseTrust):
        raise BrokenSequence(
            f"pose_trust in sequence.json must be one of {', '.join(PoseTrust)}; got {stored!r}"
        )
    return PoseTrust(stored)


def read_quality(path: Path) -> dict[str, Any] | None:
    """The quality report stored with the sequence in `path`, if any."""
    return _read_json(path / "sequence.json").get("quality")


def write_sequence(
    path: Path,
    *,
    person: str,
    frames_per_second: float,
    body: Body,
    train: Iterable[Frame],
    test: Mapping[str, Iterable[Frame]] | None = None,
    confidence: Float[Array, "F 24"] | None = None,
    source: str,
    pose_trust: PoseTrust,
    quality: Mapping[str, Any] | Callable[[], Mapping[str, Any]] | None = None,
) -> None:
    """Write a sequence folder. It appears at `path` whole, or not at all.

    Frames are consumed one by one, so memory holds only one. `quality` may be a function, called
    when all frames are written. Raises BrokenSequence if `path` exists.
    """
    if path.exists():
        raise BrokenSequence(f"out must not exist yet; got {path}; remove it or choose another")
    path.parent.mkdir(parents=True, exist_ok=True)
    building = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
    try:
        split = {"train": _write_frames(building, train, confidence)}
        for name, frames in (test or {}).items():
            split[name] = _write_frames(building / "test" / name, frames, None)
        _write_body(building / "body.npz", body)
        about = {
            "version": VERSION,
            "person": person,
            "frames_per_second": frames_per_second,
            "split": split,
            "source": source,
            "pose_trust": pose_trust,
            "quality": quality() if callable(quality) else quality,
        }
        (building / "sequence.json").write_text(json.dumps(about, indent=1) + "\n")
        building.chmod(0o755)
        building.rename(path)
    except BaseException:
        shutil.rmtree(building, ignore_errors=True)
        raise


def _open_frames(folder: Path) -> FolderFrames:
    stored = _read_arrays(folder / "cameras.npz", "intrinsics", "world_to_camera", "size")
    moved = _read_arrays(
        folder / "motion.npz", "times_s", "joint_angles", "root_translation", "confidence"
    )
    try:
        arrays = {k: moved[k].astype(np.float64) for k in moved}
        if "expressions" in arrays:
            arrays["expressions"] = values_of_any_version(arrays["expressions"])
        motion = Motion(**arrays)
        distortion = stored.get("distortion")
        sizes = np.broadcast_to(stored["size"], (len(stored["intrinsics"]), 2))
        cameras = tuple(
            Camera(
                stored["intrinsics"][i],
                stored["world_to_camera"][i],
                int(sizes[i, 0]),
                int(sizes[i, 1]),
                None if distortion is None else distortion[i],
            )
            for i in range(len(stored["intrinsics"]))
        )
    except BrokenSequence:
        raise
    except (SceneError, IndexError, ValueError, TypeError, OverflowError) as error:
        raise BrokenSequence(f"{folder.name}: {error}") from error
    if len(cameras) != len(motion):
        raise BrokenSequence(
            f"{folder.name} must have one camera a pose; got {len(cameras)} and {len(motion)}"
        )
    return FolderFrames(folder, cameras, motion)


def _read_body(path: Path) -> Body:
    stored = _read_arrays(path, "rest_joints")
    parts = [stored.get(k) for k in ("rest_vertices", "faces", "blend_weights")]
    vertices, faces, weights = parts
    directions = stored.get("expression_directions")
    if faces is not None and faces.dtype.kind not in "iu":
        raise BrokenSequence(f"body.npz: faces must be whole numbers; got {faces.dtype}")
    try:
        if directions is not None:
            directions = offsets_of_any_version(directions.astype(np.float64), axis=0)
        return Body(
            Skeleton(stored["rest_joints"]),
            None if vertices is None else vertices.astype(np.float64),
            None if faces is None else faces.astype(np.int64),
            None if weights is None else weights.astype(np.float64),
            directions,
        )
    except (SceneError, IndexError, ValueError, TypeError) as error:
        raise BrokenSequence(f"body.npz: {error}") from error


def _read_arrays(path: Path, *required: str) -> dict[str, Array]:
    try:
        stored = np.load(path, allow_pickle=False)
        if isinstance(stored, np.ndarray):
            raise ValueError("one array")
        with stored:
            unpacked = sum(entry.file_size for entry in stored.zip.infolist())
            if unpacked > _MOST_UNPACKED_BYTES:
                raise ValueError(f"{unpacked >> 20} MiB, of {_MOST_UNPACKED_BYTES >> 20} at most")
            arrays = dict(stored)
    except _NO_ARRAYS as error:
        raise BrokenSequence(f"{path.name} must be a readable .npz file; got {error}") from error
    for name, array in arrays.items():
        if array.dtype.kind not in "biuf":
            raise BrokenSequence(f"{path.name}: {name} must be real numbers; got {array.dtype}")
    missing = [name for name in required if name not in arrays]
    if missing:
        raise BrokenSequence(
            f"{path.name} must hold {', '.join(required)}; {missing[0]} is missing"
        )
    return arrays


def _read_json(path: Path) -> dict[str, Any]:
    try:
        about = json.loads(path.read_text())
    except (OSError, ValueError, RecursionError) as error:
        raise BrokenSequence(
            f"{path.parent} must be a sequence folder with a {path.name}; got {error}"
        ) from error
    if not isinstance(about, dict):
        raise BrokenSequence(f"{path.name} must hold an object; got {about!r}; capture again")
    return about


def _write_frames(
    folder: Path, frames: Iterable[Frame], confidence: Float[Array, "F 24"] | None
) -> int:
    for kind in ("images", "masks"):
        (folder / kind).mkdir(parents=True, exist_ok=True)
    cameras: list[Camera] = []
    poses: list[Pose] = []
    for index, frame in enumerate(frames):
        rgb = (np.clip(frame.image, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
        alpha = (np.clip(frame.mask, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
        _write_png(folder / "images" / f"{index:06d}.png", rgb[..., ::-1])
        _write_png(folder / "masks" / f"{index:06d}.png", alpha)
        cameras.append(frame.camera)
        poses.append(frame.pose)
    motion = Motion.from_poses(poses)
    moved: dict[str, Any] = {
        "times_s": motion.times_s,
        "joint_angles": motion.joint_angles,
        "root_translation": motion.root_translation,
        "confidence": motion.confidence if confidence is None else confidence,
    }
    if motion.expressions.any():  # else the bytes, and so the hash, are those of older files
        moved["expressions"] = motion.expressions
    np.savez_compressed(folder / "motion.npz", **moved)
    sizes = np.array([[c.width, c.height] for c in cameras])
    arrays: dict[str, Any] = {  # Any: numpy's stubs take a mapping's values for its options
        "intrinsics": np.stack([c.intrinsics for c in cameras]),
        "world_to_camera": np.stack([c.world_to_camera for c in cameras]),
        "size": sizes[0] if (sizes == sizes[0]).all() else sizes,
    }
    if cameras[0].distortion is not None:
        arrays["distortion"] = np.stack([c.distortion for c in cameras if c.distortion is not None])
    np.savez_compressed(folder / "cameras.npz", **arrays)
    return len(cameras)


def _write_png(path: Path, pixels: Array) -> None:
    ok, data = cv2.imencode(".png", pixels)
    if not ok:
        raise BrokenSequence(f"{path.name} can't be encoded; got an image of {pixels.shape}")
    path.write_bytes(data.tobytes())  # unlike cv2.imwrite, this tells of a full disk


def _write_body(path: Path, body: Body) -> None:
    arrays: dict[str, Any] = {"rest_joints": body.skeleton.rest_joints}
    if body.rest_vertices is not None and body.faces is not None and body.blend_weights is not None:
        arrays |= {
            "rest_vertices": body.rest_vertices.astype(np.float32),
            "faces": body.faces.astype(np.int32),
            "blend_weights": body.blend_weights.astype(np.float32),
        }
    if body.expression_directions is not None:
        arrays["expression_directions"] = body.expression_directions.astype(np.float16)
    np.savez_compressed(path, **arrays)


def _data_hash(path: Path) -> str:
    """sha256 over the names and bytes of everything that training reads."""
    digest = hashlib.sha256()
    files = [path / name for name in ("cameras.npz", "motion.npz", "body.npz")]
    for kind in ("images", "masks"):
        with suppress(FileNotFoundError):
            files += sorted((path / kind).iterdir())
    for file in files:
        digest.update(file.relative_to(path).as_posix().encode())
        with file.open("rb") as stream:
            while block := stream.read(1 << 20):
                digest.update(block)
    return digest.hexdigest()
