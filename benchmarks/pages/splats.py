"""What splats are worth and what drawing them takes, as docs/splats.md, room.md and frontier.md
show it."""

from __future__ import annotations

from benchmarks.pages.provenance import Figures, measured_at
from benchmarks.reporting.markdown import markdown_table

_TRAININGS = (
    ("density alone", "splats three times as dense there, no expressions"),
    ("expressions at even density", "expressions, splats as dense as elsewhere"),
    ("both", "both, as it is"),
)
_EXPRESSIONS = {
    "jaw_open": "jaw",
    "blink_left": "left lid, on the crop of its eye (5 cm)",
    "blink_right": "right lid, likewise",
    "brows_up": "brows",
    "smile": "smile",
    "left_hand_curl": "left hand",
    "right_hand_curl": "right hand",
    "fingers apart": "fingers that bend one by one, in place of all by their mean",
}

_FOREIGN = {
    "as trained": "as `metanerf train` does",
    "poses believed": "poses left alone",
    "true surface": "poses left alone, the surface that was drawn",
}
_SPLITS = ("novel_view", "unseen_pose")
_MEASURES = (("psnr", 1.0, 1), ("ssim", 1.0, 3), ("lpips", 1e3, 0))
"""Measure, what it is multiplied with in the table, decimals."""


def trainings(figures: Figures) -> str:
    """dB of face and hands by every way to train them."""
    nothing = [
        sum(row["db"]["off"][part] for row in rows) / len(rows)
        for part in ("face", "hands")
        for rows in [[row for row in figures["rows"] if row["part"] == part]]
    ]
    rows = [["no expressions", *(f"{db:.1f}" for db in nothing)]]
    for way, words in _TRAININGS:
        both = [figures["worth"][f"{part}: {way}"] for part in ("face", "hands")]
        rows.append([words, *(_gain(worth, 1) for worth in both)])
    return "\n\n".join([markdown_table(["", "face", "hands"], rows), measured_at(figures)])


def expressions(figures: Figures) -> str:
    """What each expression alone is worth."""
    worth = figures["worth"]
    rows = [[words, _gain(worth[key], 2)] for key, words in _EXPRESSIONS.items() if key in worth]
    return markdown_table(["expression", "dB on the crop"], rows)


def local_view(figures: Figures) -> str:
    """Pictures a second that a page draws by itself, a row a number of splats."""
    sizes = sorted({row["size"] for row in figures["drawn"]})
    rows = [
        [
            f"{count:,}",
            *(
                f"{row['pictures_per_second']:.0f} a second, {row['processor_ms']:.0f} ms"
                + (" of processor time each" if (count, size) == (5000, sizes[0]) else "")
                for size in sizes
                for row in figures["drawn"]
                if (row["splats"], row["size"]) == (count, size)
            ),
        ]
        for count in sorted({row["splats"] for row in figures["drawn"]})
    ]
    head = ["splats", *(f"{size} x {size}" for size in sizes)]
    return "\n\n".join([markdown_table(head, rows), measured_at(figures)])


def meeting(figures: Figures) -> str:
    """Frames a second and latency, by who draws."""
    shown = {
        (
            row["performers"],
            row["viewers"],
            row["drawn_by"],
        ): f"{row['frames_per_second']:.0f} a second, {row['latency_p50_ms']} ms "
        f"(p95 {row['latency_p95_ms']})"
        for row in figures["rows"]
    }
    rows = [
        [
            f"{performers}, {viewers}",
            *(shown.get((performers, viewers, way), "") for way in ("server", "page")),
        ]
        for performers, viewers in sorted({key[:2] for key in shown})
    ]
    head = ["performers, viewers", "by the server", "by the page"]
    return "\n\n".join([markdown_table(head, rows), measured_at(figures)])


def relight(figures: Figures) -> str:
    """dB to the truth in another room's light, as captured and relit."""
    rows = [
        [
            row["performer"],
            row["filmed_in"],
            row["shown_in"],
            f"{row['psnr_as_filmed']:.1f}",
            f"{row['psnr_relit']:.1f}",
            f"{row['gain_db']:.1f}",
        ]
        for row in figures["rows"]
    ]
    head = ["performer", "filmed in", "shown in", "as filmed", "relit", "gain"]
    return "\n\n".join([markdown_table(head, rows), measured_at(figures)])


def foreign(figures: Figures) -> str:
    """Another program's test set: what estimating poses and surface costs."""
    rows = [
        [
            _FOREIGN[row["way"]],
            f"{row['budget_s']:g} s, {row['steps']:,} steps",
            *(
                " / ".join(
                    _scaled(row[f"{measure}_{split}_body_crop"], factor, digits)
                    for split in _SPLITS
                )
                for measure, factor, digits in _MEASURES
            ),
            f"{row['psnr_training_view_body_crop']:.1f}",
        ]
        for row in figures["rows"]
    ]
    head = ["splats", "training", "PSNR, dB", "SSIM", "LPIPS x1000", "own views, dB"]
    return "\n\n".join([markdown_table(head, rows), measured_at(figures)])


def reading(figures: Figures) -> str:
    """How long a large data set takes."""
    side = figures["size"]
    sentence = (
        f"{figures['frames']} frames of {side} x {side} px are read and cut to the person in "
        f"{figures['seconds']:.1f} s on {figures['threads']} threads (`metanerf bench reading`). "
    )
    return sentence + measured_at(figures)


def _scaled(value: float | None, factor: float, digits: int) -> str:
    return "-" if value is None else f"{factor * value:.{digits}f}"


def _gain(worth: Figures, digits: int) -> str:
    return f"{worth['gain_db']:+.{digits}f} (± {worth['spread_db']:.{digits}f})"
