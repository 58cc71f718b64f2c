"""Accuracy on the studio's performers, as the README shows it."""

from __future__ import annotations

from benchmarks.pages.provenance import Figures, measured_at
from benchmarks.reporting.markdown import markdown_table

_MEASURES = (("psnr", 1.0, 1), ("ssim", 1.0, 3), ("lpips", 1e3, 1))
"""Measure, what it is multiplied with in the table, decimals."""
_PAIR = ("psnr", "lpips")


def performers(figures: Figures) -> str:
    """What was measured, the table, and where it was measured."""
    return "\n\n".join([_description(figures), table(figures["means"]), measured_at(figures)])


def _description(figures: Figures) -> str:
    counted = (
        "seconds of one thread's own time"
        if figures["clock"] == "processor"
        else f"wall clock on {figures['threads']} cores"
    )
    names = dict.fromkeys(row["performer"] for row in figures["rows"])
    backbones = {
        row["conditions"]["lpips"]["backbone"]
        for row in figures["rows"]
        if row["conditions"]["lpips"] is not None
    }
    lpips = "".join(
        f"; LPIPS x1000 on the {name} backbone, inputs in [-1, 1]" for name in sorted(backbones)
    )
    return (
        f"{len(names)} studio performers ({', '.join(names)}) in recorded motion, "
        f"{figures['frames']} frames of {figures['size']} x {figures['size']} from one camera, "
        f"{figures['poses']} poses, {figures['region']}, unseen views / unseen poses, mean over "
        f"the performers (± standard deviation), training in {counted} (splats also look for the "
        "clip's light, as `metanerf train` does, which is not counted)"
        f"{lpips} (`metanerf bench performers`):"
    )


def table(means: list[Figures]) -> str:
    """Unseen views / unseen poses, in Markdown."""
    rows = []
    for mean in means:
        cells = []
        for measure, factor, digits in _MEASURES:
            pair = [mean[f"{measure}_{split}"] for split in ("novel_view", "unseen_pose")]
            cells.append(" / ".join("-" if v is None else f"{factor * v:.{digits}f}" for v in pair))
        spread = mean["psnr_novel_view_spread"]
        rows.append(
            [
                mean["look"],
                f"`{mean['preset']}`",
                f"{mean['budget_s']:g} s",
                f"{cells[0]} (± {spread:.1f})",
                *cells[1:],
            ]
        )
    return markdown_table(["look", "preset", "training", "PSNR, dB", "SSIM", "LPIPS"], rows)


def lifelike(figures: Figures) -> str:
    """Each lifelike performer by itself, with what they look like."""
    rows = []
    for row in figures["rows"]:
        cells = []
        for split in ("novel_view", "unseen_pose"):
            decibels, distance = (row[f"{measure}_{split}_body_crop"] for measure in _PAIR)
            cells.append(f"{decibels:.1f} / {distance:.3f}")
        rows.append([row["performer"], f"{row['tone']}, {row['age']}", row["hair"], *cells])
    must = figures["must"]
    return "\n\n".join(
        [
            f"{figures['frames']} frames of {figures['size']} x {figures['size']} from one camera, "
            f"{figures['poses']} poses, {figures['budget_s']:g} s of one thread, PSNR (dB) / LPIPS "
            f"on `{figures['lpips'].removesuffix('.pth')}`, {figures['region']} "
            f"(`metanerf bench lifelike`); {must['psnr']:g} dB and {must['lpips']:g} are wanted:",
            markdown_table(["performer", "skin", "hair", "unseen views", "unseen poses"], rows),
            measured_at(figures),
        ]
    )


def covered_torso(figures: Figures) -> str:
    """LPIPS of the torso that hands covered and of the rest, of each performer."""
    rows = [
        [
            row["performer"],
            row["poses"],
            f"{row['lpips_covered']:.3f} ({100 * row['covered_of_torso']:.0f} %)",
            f"{row['lpips_rest']:.3f} ({100 * row['rest_of_torso']:.0f} %)",
            f"{row['lpips_more']:+.3f}",
        ]
        for row in figures["rows"]
    ]
    sentence = (
        f"{len({row['performer'] for row in figures['rows']})} lifelike performers, "
        f"{figures['frames']} frames of {figures['size']} x {figures['size']} from the waist up, "
        "hands before the chest throughout, with exact poses or captured from pixels; then, hands "
        f"away, LPIPS (`{figures['lpips'].removesuffix('.pth')}`) of what hands had hidden in "
        f"{100 * figures['covered_share']:.0f} % of the frames and more, and of what they had "
        f"hidden in at most {100 * figures['rest_share']:.0f} %, with how much of the torso that "
        f"is (`metanerf bench covered-torso`); {figures['must']:g} more is allowed, "
        f"{figures['aim']:g} aimed at:"
    )
    head = ["performer", "poses", "covered", "the rest", "more"]
    return "\n\n".join([sentence, markdown_table(head, rows), measured_at(figures)])


def expressions_found(figures: Figures) -> str:
    """Errors of gaze, face and fingers, mean over lifelike performers."""
    rows, means = figures["rows"], figures["means"]
    cells = [["eyes aside", f"{means['gaze_deg']:.1f}°", f"{means['gaze_spread_deg']:.1f}°"]]
    for name in rows[0]["skin"]:
        error, spread = (
            sum(row["skin"][name][of] for row in rows) / len(rows) for of in ("error", "spread")
        )
        cells.append([name.replace("_", " "), f"{error:.2f}", f"{spread:.2f}"])
    cells.append(["each joint of a finger", f"{means['finger_joints_deg']:.1f}°", "-"])
    return "\n\n".join(
        [
            f"{len(rows)} lifelike performers, {figures['pictures']} pictures of "
            f"{figures['size']} x {figures['size']} of the face and of each hand, of which "
            f"{100 * means['hands_found']:.0f} % were found; mean error, and how far the truth is "
            "from rest (eyes) or from its mean (`metanerf bench expressions-found`):",
            markdown_table(["what", "error", "truth"], cells),
            measured_at(figures),
        ]
    )
