"""Motion capture in BVH, retargeted onto the 24 joints.

Three skeleton families of the CMU database are known by their joint names: MotionBuilder (MB), DAZ
and the original ASF. Rotation orders are read from each CHANNELS line. Retargeting transfers global
rotations: a bone's rotation away from the file's rest pose, after the rest pose itself is rotated
to our T-pose by the bones' directions."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from capture.errors import BrokenMotionCapture
from scene.arrays import Array, Float
from scene.motion import Motion
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle, rotation_between
from scene.skeleton import JOINT_COUNT, JOINT_NAMES, PARENTS, Skeleton

_AXES = {"X": 0, "Y": 1, "Z": 2}
_CHILD_OF = {
    "left_hip": "left_knee",
    "left_knee": "left_ankle",
    "left_shoulder": "left_elbow",
    "left_elbow": "left_wrist",
    "right_hip": "right_knee",
    "right_knee": "right_ankle",
    "right_shoulder": "right_elbow",
    "right_elbow": "right_wrist",
}
"""Limbs, whose direction at rest differs between skeletons; trunks all stand upright."""

_FOLLOWS_LIMB = {"wrist": "elbow", "ankle": "knee", "foot": "knee"}
"""Hands and feet take the rotation of their limb: legs that are apart at rest tilt the soles,
too."""

_LEGS = tuple(f"{side}_{part}" for side in ("left", "right") for part in ("hip", "knee", "ankle"))
"""Required of every clip: leg length sets the scale, and the feet the floor."""

_SIDED = {
    "MB": {
        "hip": "UpLeg",
        "knee": "Leg",
        "ankle": "Foot",
        "foot": "ToeBase",
        "collar": "Shoulder",
        "shoulder": "Arm",
        "elbow": "ForeArm",
        "wrist": "Hand",
    },
    "DAZ": {
        "hip": "Thigh",
        "knee": "Shin",
        "ankle": "Foot",
        "collar": "Collar",
        "shoulder": "Shldr",
        "elbow": "ForeArm",
        "wrist": "Hand",
    },
    "ASF": {
        "hip": "femur",
        "knee": "tibia",
        "ankle": "foot",
        "foot": "toes",
        "collar": "clavicle",
        "shoulder": "humerus",
        "elbow": "radius",
        "wrist": "wrist",
    },
}
_TRUNK = {
    "MB": {
        "pelvis": "Hips",
        "spine1": "LowerBack",
        "spine2": "Spine",
        "spine3": "Spine1",
        "neck": "Neck",
        "head": "Head",
    },
    "DAZ": {
        "pelvis": "hip",
        "spine1": "abdomen",
        "spine3": "chest",
        "neck": "neck",
        "head": "head",
    },
    "ASF": {
        "pelvis": "root",
        "spine1": "lowerback",
        "spine2": "upperback",
        "spine3": "thorax",
        "neck": "lowerneck",
        "head": "head",
    },
}
_PREFIX = {"MB": ("Left", "Right"), "DAZ": ("l", "r"), "ASF": ("l", "r")}


@dataclass(frozen=True, eq=False)
class Bvh:
    """A parsed file: a tree of joints and its channels."""

    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: Float[Array, "J 3"]
    """File units."""
    rotations: Float[Array, "F J 3 3"]
    """Joint frame -> parent."""
    positions: Float[Array, "F 3"]
    """Root, file units."""
    frame_time_s: float

    def world(self) -> tuple[Float[Array, "F J 3 3"], Float[Array, "F J 3"]]:
        """Global rotations and positions by forward kinematics."""
        global_rotations, joint_positions = (
            self.rotations.copy(),
            np.zeros((*self.rotations.shape[:2], 3)),
        )
        for joint, parent in enumerate(self.parents):
            if parent < 0:
                joint_positions[:, joint] = self.positions
                continue
            global_rotations[:, joint] = global_rotations[:, parent] @ self.rotations[:, joint]
            joint_positions[:, joint] = (
                joint_positions[:, parent] + global_rotations[:, parent] @ self.offsets[joint]
            )
        return global_rotations, joint_positions


def parse_bvh(text: str) -> Bvh:
    """Parse a BVH file. Raises BrokenMotionCapture with the rule that is broken."""
    hierarchy, found, motion = text.partition("MOTION")
    if not hierarchy.strip().startswith("HIERARCHY") or not found:
        raise BrokenMotionCapture(
            f"a BVH file must hold HIERARCHY and MOTION; got {text[:40].strip()!r}"
        )
    names, parents, offsets, channels = _parse_tree(hierarchy.split())
    lines = motion.strip().splitlines()
    try:
        declared, frame_time_s = int(lines[0].split(":")[1]), float(lines[1].split(":")[1])
        rows = np.array([line.split() for line in lines[2:] if line.strip()], dtype=np.float64)
    except (IndexError, ValueError) as error:
        raise BrokenMotionCapture(f"MOTION must hold numbers only; got {error}") from error
    wanted = sum(len(c) for c in channels)
    if rows.ndim != 2 or rows.shape[1] != wanted or not np.isfinite(rows).all():
        raise BrokenMotionCapture(
            f"every frame must hold {wanted} finite channels; got an array of {rows.shape}"
        )
    if len(rows) != declared:
        raise BrokenMotionCapture(
            f"MOTION must hold the {declared} frames it declares; got {len(rows)}; fetch it again"
        )
    if not 0.0 < frame_time_s < np.inf:
        raise BrokenMotionCapture(f"Frame Time must be positive; got {frame_time_s}")
    positions, rotations = _read_channels(rows, channels)
    return Bvh(tuple(names), tuple(parents), np.array(offsets), rotations, positions, frame_time_s)


def read_bvh(path: Path, skeleton: Skeleton) -> Motion:
    """The motion in `path` on `skeleton`: limbs by direction, feet on the floor, from x = z = 0.

    A file `tpose/<name>.tpose.bvh` beside it gives the rest pose where the zero pose is no T-pose.
    Raises BrokenMotionCapture for an unreadable file or an unknown skeleton.
    """
    try:
        clip = parse_bvh(path.read_text())
    except (OSError, UnicodeDecodeError) as error:
        raise BrokenMotionCapture(f"{path} must be a readable BVH file; got {error}") from error
    family = _family(clip)
    rest_file = path.parent / "tpose" / f"{path.stem}.tpose.bvh"
    rest = parse_bvh(rest_file.read_text()) if rest_file.exists() else _zero_pose(clip)
    return retarget(clip, rest, family, skeleton)


def retarget(clip: Bvh, rest: Bvh, family: str, skeleton: Skeleton) -> Motion:
    """Global rotations relative to `rest` (first frame), carried to `skeleton`."""
    source_joints = _mapping(clip, family)
    global_rotations, joint_positions = clip.world()
    rest_rotations, rest_positions = (part[0] for part in rest.world())
    world = np.tile(np.eye(3), (len(global_rotations), JOINT_COUNT, 1, 1))
    for joint, name in enumerate(JOINT_NAMES):
        source = source_joints.get(name)
        if source is None:
            world[:, joint] = world[:, PARENTS[joint]]
            continue
        relative = global_rotations[:, source] @ rest_rotations[source].T
        world[:, joint] = relative @ _to_t_pose(name, source_joints, rest_positions, skeleton).T
    local = world.copy()
    for joint in range(1, JOINT_COUNT):
        local[:, joint] = np.swapaxes(world[:, PARENTS[joint]], -1, -2) @ world[:, joint]
    angles = matrix_to_axis_angle(local)
    file_leg = np.linalg.norm(
        rest_positions[source_joints["left_hip"]] - rest_positions[source_joints["left_knee"]]
    ) + np.linalg.norm(
        rest_positions[source_joints["left_knee"]] - rest_positions[source_joints["left_ankle"]]
    )
    leg = (
        skeleton.rest_joints[JOINT_NAMES.index("left_hip"), 1]
        - (skeleton.rest_joints[JOINT_NAMES.index("left_ankle"), 1])
    )
    root = joint_positions[:, source_joints["pelvis"]] * (leg / file_leg)
    root = root - root[0] * [1.0, 0.0, 1.0] - skeleton.rest_joints[0] * [0.0, 1.0, 0.0]
    times = np.arange(len(root)) * clip.frame_time_s
    motion = Motion(times, angles, root, np.ones((len(root), JOINT_COUNT)))
    return _align_to_floor(motion, skeleton)


def _to_t_pose(name: str, source_joints: dict[str, int], rest: Array, skeleton: Skeleton) -> Array:
    """The rotation that takes the limb `name` from the file's rest pose to our T-pose."""
    for end, limb in _FOLLOWS_LIMB.items():
        name = name.replace(end, limb)
    child = _CHILD_OF.get(name, "")
    if child not in source_joints:
        return np.eye(3)
    start, end = JOINT_NAMES.index(name), JOINT_NAMES.index(child)
    source_direction = rest[source_joints[child]] - rest[source_joints[name]]
    return rotation_between(
        source_direction, skeleton.rest_joints[end] - skeleton.rest_joints[start]
    )


def _align_to_floor(motion: Motion, skeleton: Skeleton) -> Motion:
    """Lower or lift the clip so that heels and toes, at their lowest in most frames, stand at rest
    height."""
    drop = skeleton.ground_height(motion.joint_angles, motion.root_translation)
    root = motion.root_translation - [0.0, drop, 0.0]
    return Motion(motion.times_s, motion.joint_angles, root, motion.confidence)


def _family(clip: Bvh) -> str:
    for family, trunk in _TRUNK.items():
        if trunk["pelvis"] in clip.names and trunk["spine1"] in clip.names:
            return family
    raise BrokenMotionCapture(
        f"the skeleton must be of the family {', '.join(_TRUNK)}; got joints {clip.names[:6]}"
    )


def _mapping(clip: Bvh, family: str) -> dict[str, int]:
    source_names = dict(_TRUNK[family])
    for side, prefix in zip(("left", "right"), _PREFIX[family], strict=True):
        for part, suffix in _SIDED[family].items():
            source_names[f"{side}_{part}"] = prefix + suffix
    mapped = {
        part: clip.names.index(name) for part, name in source_names.items() if name in clip.names
    }
    missing = [joint for joint in _LEGS if joint not in mapped]
    if missing:
        raise BrokenMotionCapture(
            f"the skeleton must have both legs; {missing[0]} is missing, named "
            f"{source_names[missing[0]]}"
        )
    return mapped


def _zero_pose(clip: Bvh) -> Bvh:
    identity = np.tile(np.eye(3), (1, len(clip.names), 1, 1))
    return Bvh(
        clip.names, clip.parents, clip.offsets, identity, np.zeros((1, 3)), clip.frame_time_s
    )


def _parse_tree(
    tokens: list[str],
) -> tuple[list[str], list[int], list[list[float]], list[list[str]]]:
    names: list[str] = []
    parents: list[int] = []
    offsets: list[list[float]] = []
    channels: list[list[str]] = []
    stack: list[int] = []
    position, ends = 1, 0
    try:
        while position < len(tokens):
            word = tokens[position]
            if word in ("ROOT", "JOINT"):
                names.append(tokens[position + 1])
                parents.append(stack[-1] if stack else -1)
                offsets.append([0.0, 0.0, 0.0])
                channels.append([])
                position += 2
            elif word == "End":
                ends, position = ends + 1, position + 2
            elif word == "{":
                stack.append(-2 if ends else len(names) - 1)
                position += 1
            elif word == "}":
                ends -= 1 if stack.pop() == -2 else 0
                position += 1
            elif word == "OFFSET":
                if not ends:
                    offsets[stack[-1]] = [float(t) for t in tokens[position + 1 : position + 4]]
                position += 4
            elif word == "CHANNELS":
                count = int(tokens[position + 1])
                channels[stack[-1]] = _require_channels(tokens[position + 2 : position + 2 + count])
                position += 2 + count
            else:
                raise ValueError(f"unknown word {word!r}")
    except (IndexError, ValueError) as error:
        raise BrokenMotionCapture(f"HIERARCHY must be a tree of joints; got {error}") from error
    return names, parents, offsets, channels


def _require_channels(channels: list[str]) -> list[str]:
    for name in channels:
        if name[:1] not in _AXES or name[1:] not in ("position", "rotation"):
            raise ValueError(f"channels must be Xposition, ..., Zrotation; got {name!r}")
    return channels


def _read_channels(rows: Array, channels: list[list[str]]) -> tuple[Array, Array]:
    rotations = np.tile(np.eye(3), (len(rows), len(channels), 1, 1))
    positions = np.zeros((len(rows), 3))
    column = 0
    for joint, names in enumerate(channels):
        for name in names:
            axis = _AXES[name[0]]
            if name.endswith("position"):
                if joint == 0:
                    positions[:, axis] = rows[:, column]
            else:
                vector = np.zeros((len(rows), 3))
                vector[:, axis] = np.deg2rad(rows[:, column])
                rotations[:, joint] = rotations[:, joint] @ axis_angle_to_matrix(vector)
            column += 1
    return positions, rotations
