"""Tiny BVH files written by hand: a person of sixteen joints, legs of 40 + 40 units."""

from __future__ import annotations

from dataclasses import dataclass

ORDER = "Zrotation Yrotation Xrotation"


@dataclass(frozen=True)
class Bone:
    """A joint, where it sits in its parent (file units), and what hangs from it."""

    name: str
    offset: tuple[float, float, float]
    children: tuple[Bone, ...] = ()


def person(spread: float = 0.0) -> Bone:
    """MotionBuilder names, arms along +-x; each ankle `spread` units outside its hip."""

    def leg(side: str, out: float) -> Bone:
        half = (out * spread / 2.0, -40.0, 0.0)
        toe = Bone(f"{side}ToeBase", (0.0, -5.0, 15.0))
        shin = Bone(f"{side}Leg", half, (Bone(f"{side}Foot", half, (toe,)),))
        return Bone(f"{side}UpLeg", (out * 10.0, -5.0, 0.0), (shin,))

    def arm(side: str, out: float) -> Bone:
        hand = Bone(f"{side}Hand", (out * 25.0, 0.0, 0.0))
        forearm = Bone(f"{side}ForeArm", (out * 28.0, 0.0, 0.0), (hand,))
        return Bone(f"{side}Arm", (out * 15.0, 30.0, 0.0), (forearm,))

    spine = Bone("LowerBack", (0.0, 10.0, 0.0), (arm("Left", 1.0), arm("Right", -1.0)))
    return Bone("Hips", (0.0, 0.0, 0.0), (leg("Left", 1.0), leg("Right", -1.0), spine))


def names_of(bone: Bone) -> list[str]:
    """Names in the order of the file."""
    return [bone.name, *(name for child in bone.children for name in names_of(child))]


def bvh_text(
    root: Bone,
    frames: list[dict[str, tuple[float, float, float]]],
    *,
    order: str = ORDER,
    frame_time_s: float = 0.1,
) -> str:
    """A file. A frame maps joint names to degrees in `order`, and "root" to a position."""
    rows = []
    for frame in frames:
        values = list(frame.get("root", (0.0, 90.0, 0.0)))
        for name in names_of(root):
            values += frame.get(name, (0.0, 0.0, 0.0))
        rows.append(" ".join(f"{value:.6f}" for value in values))
    motion = f"MOTION\nFrames: {len(rows)}\nFrame Time: {frame_time_s}\n"
    return f"HIERARCHY\n{_joint_text(root, 'ROOT', order)}{motion}" + "\n".join(rows) + "\n"


def _joint_text(bone: Bone, word: str, order: str) -> str:
    place = "Xposition Yposition Zposition " if word == "ROOT" else ""
    inside = "".join(_joint_text(child, "JOINT", order) for child in bone.children)
    inside = inside or "End Site\n{\nOFFSET 0 0 1\n}\n"
    offset = " ".join(str(value) for value in bone.offset)
    channels = f"CHANNELS {6 if place else 3} {place}{order}"
    return f"{word} {bone.name}\n{{\nOFFSET {offset}\n{channels}\n{inside}}}\n"
