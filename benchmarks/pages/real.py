"""Models of real people, as docs/real-people.md shows them."""

from __future__ import annotations

from benchmarks.pages.provenance import Figures, measured_at
from benchmarks.reporting.markdown import markdown_table

_VIEWS = (
    ("own views", "as_given", "own_views"),
    ("later frames", "aligned", "later_frames"),
    ("other clips", "aligned", "other_clips"),
    ("other cameras", "as_given", "other_cameras"),
)
"""Name in the table, which poses, which group of frames."""
_HEADS = {"solved": "by the body's landmarks", "followed": "by the face's points as well"}


def real(figures: Figures) -> str:
    """What was measured, the tables, and where it was measured."""
    return "\n\n".join(
        [_description(figures), _accuracy(figures), _effort(figures), measured_at(figures)]
    )


def live_head(figures: Figures) -> str:
    """Angles of real heads from where their faces have them."""
    rows = [
        [row["clip"], str(row["pictures"]), *(_head_cell(row[kind]) for kind in _HEADS)]
        for row in figures["rows"]
    ]
    sentence = (
        "Angle between the head and where its face's points have it, mean and 95th percentile, "
        f"degrees; a face is looked for in one of {figures['every']} pictures and comes "
        f"{figures['late']} pictures late. In brackets how unsteady the head is: the mean change "
        "of its turn from one picture to the next (`metanerf bench live-head`):"
    )
    head = ["clip", "pictures", *_HEADS.values()]
    return "\n\n".join([sentence, markdown_table(head, rows), measured_at(figures)])


def _head_cell(errors: Figures) -> str:
    return f"{errors['mean']:.1f}, {errors['p95']:.1f} ({errors['unsteady']:.2f})"


def _description(figures: Figures) -> str:
    return (
        f"Each model is trained in {figures['iterations']:,} steps; LPIPS is on "
        f"`{figures['lpips'].removesuffix('.pth')}`. A cell is PSNR (dB) / LPIPS of that crop, the "
        "mean over so many frames; later frames and other clips are aligned by their own pictures "
        "first (`metanerf bench real`):"
    )


def _accuracy(figures: Figures) -> str:
    rows = [
        [name, f"{title} ({found['frames']})", *_cells(found)]
        for name, case in figures["cases"].items()
        for title, poses, group in _VIEWS
        if (found := case[poses].get(group)) is not None
    ]
    heads = [
        "person",
        "frames",
        "body",
        "face",
        "hands",
        "overlap",
        "face found",
        "its points",
        "irises",
        "flicker",
    ]
    return markdown_table(heads, rows)


def _cells(found: Figures) -> list[str]:
    face, flicker = found["face"], found["flicker"]
    seen = face.get("found")
    return [
        *(_pair(found[part]) for part in ("body", "face", "hands")),
        f"{found['body']['iou']:.3f}",
        "-" if seen is None else f"{100 * seen:.0f} %",
        *(_percent(face.get(name)) for name in ("points_percent", "irises_percent")),
        "-" if flicker is None else f"{flicker:.2f}",
    ]


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f} %"


def _pair(part: Figures) -> str:
    return "-" if part.get("psnr") is None else f"{part['psnr']:.1f} / {part['lpips']:.3f}"


def _effort(figures: Figures) -> str:
    rows = []
    for name, case in figures["cases"].items():
        clips = [
            f"{clip}: {about['frames']} frames, {about['seconds']:g} s, captured in "
            f"{about['capture_s']:.0f} s"
            for clip, about in case["clips"].items()
        ]
        trained_in = f"{case['training_s']:.0f}"
        splats, frames = f"{case['splats']:,}", str(case["trained_frames"])
        rows.append([name, splats, frames, trained_in, "; ".join(clips)])
    return markdown_table(["person", "splats", "frames trained on", "trained in, s", "clips"], rows)
