"""The frozen ruler of `metanerf bench real`: masks, faces and hands of real test frames.

    python -m tools.build_real_ruler FOOTAGE MODELS [CLIP...] [--sheet FILE.png]

Cut out by capture's own segmentation as it was on the day, at the clips' own resolution, then
corrected by eye: look at every mask (`--sheet` draws them), and list what is wrong below. Once
committed the files stay, whatever becomes of capture.
"""

from __future__ import annotations

import argparse
import hashlib
import json
from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np

from benchmarks.real.parts import (
    FACE_POINTS,
    HAND_POINTS,
    PartFinder,
    Window,
    part_finder,
    window_around,
)
from benchmarks.real.ruler import RULERS
from capture.body.landmark_names import FACE_LANDMARKS, LANDMARK_NAMES
from capture.detection.landmarks import Landmarks, MediaPipeEstimator
from capture.detection.tracking import track_person
from capture.segmentation.clip import segment_clip
from capture.sources.video import Clip, read_video
from scene.arrays import Array, Float, UInt8
from tools.real_ruler_corrections import ADDED, HIDDEN, REMOVED, REMOVED_DARK, Polygon

CLIPS = {
    **{
        f"{person}_{word}": f"real-webcam-people/{person}_{word}.mkv"
        for person, words in {
            "grey_shirt": ("bird", "milk", "please", "sorry", "thanks"),
            "orange_hoodie": ("book", "learn", "school", "walk"),
            "patterned_shirt": ("eat", "night", "sister"),
        }.items()
        for word in words
    },
    **{f"desk_cam{n}": f"real-four-cameras/charuco_calibration/cam_{n}.mp4" for n in (1, 2, 3)},
    "juggler": "real-full-body/05_default_juggle.mp4",
    "walker_cam01": "real-two-cameras/cam01.mp4",
    "walker_cam02": "real-two-cameras/cam02.mp4",
}
"""Name of each clip with a ruler, and its file below the folder of footage."""
BALL = {
    0: (654, 318, 39),
    1: (653, 315, 39),
    49: (708, 466, 44),
    50: (720, 431, 43),
    98: (820, 319, 47),
    99: (820, 312, 47),
    147: (602, 433, 46),
    148: (603, 413, 46),
    196: (811, 295, 44),
    197: (817, 297, 44),
}
"""The juggler's ball, which is not the person, by frame: its middle and radius, px."""
WALL: dict[str, list[Window]] = {
    "grey_shirt": [(200, 255, 48, 150), (382, 250, 46, 180)],
    "orange_hoodie": [(222, 330, 26, 140), (375, 330, 37, 140)],
    "patterned_shirt": [(203, 295, 47, 150), (366, 295, 34, 150)],
    "desk_cam1": [(700, 178, 310, 160)],
}
"""Where a white wall shows between arm and body, or fingers, by the beginning of a clip's name:
what is as light and as grey as the wall there is not the person."""
_MOMENTS = 6
"""Pairs of successive frames, spread evenly over a clip."""
DESK_MOMENTS, DESK_FRAMES = (12, 20, 30, 48, 52, 57), 63
"""First frames of the pairs at the desk, in all cameras alike; afterwards he takes up a board."""
NO_FACE: dict[str, tuple[int, ...]] = {
    "desk_cam1": (12, 13, 20, 21, 30, 31, 48, 49, 52, 53, 57, 58),
}
"""Frames in which what was found is no face: that of a profile lies beside it, on the wall."""
_WHOLE_PX = 4096
_HAND_GROW, _HEAD_GROW, _LEAST_PX = 3.2, 2.6, 48
_SEEN = 0.5
_WALL, _DESK_WALL, _WALL_PX = (165, 45), (110, 28), 24
"""Of 8 bits: least of the darkest channel, most between the channels; least area."""
_LEVELS = 16
_ISLAND_PX = 300
"""Least area of a part of the person; at the desk every part is larger."""
_DARK = 50
"""Of 8 bits, of the lightest channel."""
_HANDS = tuple(
    [LANDMARK_NAMES.index(f"{side}_{part}") for part in ("wrist", "pinky", "index", "thumb")]
    for side in ("left", "right")
)


def build(name: str, footage: Path, models: Path, finder: PartFinder) -> None:
    """Write the ruler of one clip."""
    path = footage / CLIPS[name]
    clip = read_video(path, max_frames=100_000, max_side=_WHOLE_PX)
    images = clip.images[:DESK_FRAMES] if name.startswith("desk") else clip.images
    with MediaPipeEstimator(models / "pose_landmarker_full.task") as estimator:
        people = track_person(images, estimator).people
    masks = segment_clip(images, people)
    indices = [i for i in _pairs(name, len(images)) if people[i] is not None]
    folder = RULERS / name
    (folder / "masks").mkdir(parents=True, exist_ok=True)
    faces, hands = [], []
    for index in indices:
        person, mask = people[index], masks[index]
        assert person is not None
        assert mask is not None
        alpha = corrected((255.0 * mask + 0.5).astype(np.uint8), clip.images[index], name, index)
        cv2.imwrite(str(folder / "masks" / f"{index:04d}.png"), alpha)
        hidden = _hidden(alpha.shape, name, index)
        if hidden is not None:
            (folder / "hidden").mkdir(exist_ok=True)
            cv2.imwrite(str(folder / "hidden" / f"{index:04d}.png"), hidden)
        face = _face(finder, clip.images[index], person)
        faces.append(face if index not in NO_FACE.get(name, ()) else np.full_like(face, np.nan))
        hands.append(_hands(finder, clip.images[index], person))
    np.savez_compressed(
        folder / "points.npz", face=np.float32(np.array(faces)), hands=np.float32(np.array(hands))
    )
    about = {
        "file": CLIPS[name],
        "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
        "size": list(clip.source_size),
        "clip_frames": clip.source_frames,
        "indices": indices,
    }
    (folder / "ruler.json").write_text(json.dumps(about, indent=1) + "\n")


def corrected(
    alpha: UInt8[Array, "H W"], image: UInt8[Array, "H W 3"], name: str, index: int
) -> UInt8[Array, "H W"]:
    """The mask, without what the eye took away, in `_LEVELS` levels, which keeps files small."""
    _fill(alpha, ADDED.get(name, ()), index, 255)
    _fill(alpha, REMOVED.get(name, ()), index, 0)
    kept = _fill(alpha.copy(), REMOVED_DARK.get(name, ()), index, 0)
    alpha = np.where(image.max(2) < _DARK, kept, alpha)
    hidden = _hidden(alpha.shape, name, index)
    if hidden is not None:
        alpha[hidden > 0] = 0
    for person, windows in WALL.items():
        light, grey = _DESK_WALL if name.startswith("desk") else _WALL
        for x, y, width, height in windows if name.startswith(person) else ():
            part = slice(y, y + height), slice(x, x + width)
            seen = image[part].astype(int)
            wall = (seen.min(2) > light) & (np.ptp(seen, axis=2) < grey)
            _, labels, stats, _ = cv2.connectedComponentsWithStats(wall.astype(np.uint8))
            large = stats[:, cv2.CC_STAT_AREA] >= _WALL_PX  # print on cloth is smaller
            large[0] = False
            alpha[part][cv2.dilate(large[labels].astype(np.uint8), np.ones((3, 3))) > 0] = 0
    if name.startswith("desk"):
        _, labels, stats, _ = cv2.connectedComponentsWithStats((alpha > 0).astype(np.uint8))
        islands = np.flatnonzero(stats[:, cv2.CC_STAT_AREA] < _ISLAND_PX)
        alpha[np.isin(labels, islands)] = 0
    step = 255.0 / (_LEVELS - 1)
    return np.rint(np.rint(alpha / step) * step).astype(np.uint8)


def _hidden(shape: tuple[int, ...], name: str, index: int) -> UInt8[Array, "H W"] | None:
    """Where something stands in front of the person, 255; None where nothing does."""
    hidden = np.zeros(shape, np.uint8)
    if name == "juggler" and index in BALL:
        x, y, radius = BALL[index]
        cv2.circle(hidden, (x, y), radius, 255, -1)
    _fill(hidden, HIDDEN.get(name, ()), index, 255)
    return hidden if hidden.any() else None


def _fill(
    mask: UInt8[Array, "H W"], polygons: Iterable[Polygon], index: int, level: int
) -> UInt8[Array, "H W"]:
    """`mask`, in which those polygons that hold for frame `index` were drawn."""
    for first, last, corners in polygons:
        if first <= index <= last:
            cv2.fillPoly(mask, [np.array(corners, np.int32)], level, lineType=cv2.LINE_AA)
    return mask


def _pairs(name: str, frames: int) -> list[int]:
    evenly = np.linspace(0, frames - 2, _MOMENTS).round().astype(int)
    firsts = DESK_MOMENTS if name.startswith("desk") else evenly
    return sorted({int(i) + step for i in firsts for step in (0, 1)})


def _face(
    finder: PartFinder, image: UInt8[Array, "H W 3"], person: Landmarks
) -> Float[Array, "478 2"]:
    window = window_around(person.pixels[:FACE_LANDMARKS], _HEAD_GROW, _LEAST_PX)
    found = finder.face(image, window)
    return np.full((FACE_POINTS, 2), np.nan) if found is None else found


def _hands(
    finder: PartFinder, image: UInt8[Array, "H W 3"], person: Landmarks
) -> Float[Array, "2 21 2"]:
    found = np.full((2, HAND_POINTS, 2), np.nan)
    for place, points in enumerate(_HANDS):
        window = window_around(person.pixels[points], _HAND_GROW, _LEAST_PX)
        hand = finder.hand(image, window) if person.visibility[points].min() > _SEEN else None
        if hand is not None:
            found[place] = hand
    return found


def draw_sheet(names: list[str], footage: Path, out: Path) -> None:
    """Every first frame of a pair: what is not the person in green, points drawn."""
    from benchmarks.real.ruler import Ruler

    rows = []
    for name in names:
        ruler = Ruler.read(name)
        clip: Clip = read_video(footage / ruler.file, max_frames=100_000, max_side=_WHOLE_PX)
        cells = []
        for index in ruler.indices[::2]:
            mask = ruler.mask(index)[..., None]
            picture = clip.images[index] * mask + (1.0 - mask) * np.array([0.0, 160.0, 60.0])
            picture = np.ascontiguousarray(picture.astype(np.uint8))
            face = ruler.face(index)
            for points in [*([] if face is None else [face[::6]]), *ruler.hands(index)]:
                for x, y in points:
                    cv2.circle(picture, (round(x), round(y)), 1, (255, 255, 0), -1)
            scale = 300.0 / picture.shape[0]
            cell = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
            cv2.putText(cell, f"{name} {index}", (4, 14), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (255,) * 3)
            cells.append(cell)
        rows.append(np.concatenate(cells, axis=1))
    width = max(row.shape[1] for row in rows)
    padded = [np.pad(row, ((0, 0), (0, width - row.shape[1]), (0, 0))) for row in rows]
    cv2.imwrite(str(out), np.concatenate(padded)[..., ::-1])


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("footage", type=Path)
    parser.add_argument("models", type=Path)
    parser.add_argument("clips", nargs="*", default=list(CLIPS))
    parser.add_argument("--sheet", type=Path)
    given = parser.parse_args()
    if given.sheet is not None:
        draw_sheet(given.clips, given.footage, given.sheet)
        return
    face, hand = (given.models / f"{part}_landmarker.task" for part in ("face", "hand"))
    with part_finder(face, hand) as finder:
        for name in given.clips:
            build(name, given.footage, given.models, finder)
            print(name, flush=True)


if __name__ == "__main__":
    main()
