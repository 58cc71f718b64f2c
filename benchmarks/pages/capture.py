"""How exact captures are, as docs/capture.md and the README show it."""

from __future__ import annotations

from benchmarks.pages.provenance import Figures, measured_at
from benchmarks.reporting.markdown import markdown_table

_MASK_STAGES = {
    "estimator": "the estimator's mask",
    "cut": "cut anew",
    "with_backdrop": "with the backdrop",
    "steady": "steady in time",
    "own_colours": "own colours",
    "true_alpha": "true alpha, the picture's colours",
    "true_alpha_own_colours": "true alpha, own colours",
}
_MASK_PERFORMERS = ("lit", "loose", "hazel", "jasper")
_MASK_COLUMNS = (
    ("overlap", 3, "overlap"),
    ("alpha_error", 3, "alpha error"),
    ("colour_error_levels", 1, "colour error, levels"),
    ("flicker", 3, "flicker"),
    ("work_ms", 1, "ms a frame"),
)
"""Figure, decimals, words."""
_LIVE = (
    ("live_to_clip_fit", "live to the clip-wide fit"),
    ("live_unsmoothed_to_clip_fit", "the same, not smoothed"),
    ("clip_fit_to_truth", "clip-wide fit to the truth"),
    ("live_to_truth", "live to the truth"),
    (
        "live_with_true_body_and_camera_to_truth",
        "live, with the true body and camera, to the truth",
    ),
)
_LATE = (
    ("as_it_is", "the same, shown 60 ms late"),
    ("predicted", "the same, predicted by 60 ms"),
)


_STAGES = {
    "lifted": "the landmarks lifted to poses by a network",
    "landmarks": "the fit to the landmarks of all frames",
    "silhouette": "the outlines, optical flow and the floor",
    "second look": "a second look at the outlines",
    "refined while training": "training, which refines the poses by the pictures",
}


def masks(figures: Figures) -> str:
    """The performers beside one another, a row a stage; and the real clips."""
    performers = [figures[name] for name in _MASK_PERFORMERS if name in figures]
    rows = [
        [
            words,
            *(
                " / ".join(f"{look[stage][key]:.{digits}f}" for look in performers)
                for key, digits, _ in _MASK_COLUMNS
            ),
        ]
        for stage, words in _MASK_STAGES.items()
    ]
    head = ["stage", *(words for _, _, words in _MASK_COLUMNS)]
    real = [
        [clip, f"{row['overlap']:.3f}", f"{row['alpha_error']:.3f}", f"{row['work_ms']:.0f}"]
        for clip, row in figures["real"].items()
    ]
    of_clips = markdown_table(["real clip", "overlap", "alpha error", "ms a frame"], real)
    return "\n\n".join([markdown_table(head, rows), of_clips, measured_at(figures)])


def accuracy(figures: Figures) -> str:
    """The stages in few columns, and what captures are worth in pictures."""
    rows = [
        [
            _STAGES.get(name, name),
            f"{one['joint_mm']:.0f}",
            f"{one['joint_one_scale_mm']:.0f}",
            _degrees(one),
        ]
        for name, one in _judged(figures["mean"]).items()
    ]
    head = ["after", "joints, mm", "with one scale a clip, mm", "rotations"]
    exact, aligned, captured = _new_views_db(figures)
    return "\n\n".join(
        [
            markdown_table(head, rows),
            f"With exact poses `splats` reach {exact:.1f} dB in unseen views; with captured poses "
            f"{aligned:.1f} dB once each test pose is aligned with its own picture, and "
            f"{captured:.1f} dB as the poses are. {measured_at(figures)}",
        ]
    )


def stages(figures: Figures) -> str:
    """What each stage of the fit leaves, in the mean over clips."""
    rows = [
        [
            name,
            f"{one['joint_mm']:.0f}",
            f"{one['joint_one_scale_mm']:.0f}",
            f"{one['joint_procrustes_mm']:.0f}",
            _degrees(one),
            f"{one['root_one_scale_mm']:.0f}",
            f"{one['jitter_m_s3']:.0f} (truth {one['jitter_truth_m_s3']:.0f})",
            f"{one['seconds']:.1f}" if "seconds" in one else "",
        ]
        for name, one in _judged(figures["mean"]).items()
    ]
    head = [
        "after",
        "joints, mm",
        "with one scale",
        "Procrustes",
        "rotations",
        "root, one scale, mm",
        "jitter, m/s3",
        "s",
    ]
    return "\n\n".join([markdown_table(head, rows), measured_at(figures)])


def clips(figures: Figures) -> str:
    """Every clip: what the fit leaves, what training makes of it, and what that is worth."""
    rows = []
    for row in (*figures["rows"], {"clip": "mean", **figures["mean"]}):
        fitted, refined = list(_judged(row).values())[-2:]
        rows.append(
            [
                row["clip"],
                f"{fitted['joint_one_scale_mm']:.0f}",
                f"{refined['joint_one_scale_mm']:.0f}",
                _degrees(fitted),
                _degrees(refined),
                *(
                    _decibels(row["accuracy"][name])
                    for name in ("captured", "captured_aligned", "exact")
                ),
            ]
        )
    head = [
        "clip",
        "joints, one scale, mm",
        "refined",
        "rotations",
        "refined",
        "as they are, dB",
        "aligned, dB",
        "exact poses, dB",
    ]
    return "\n\n".join([markdown_table(head, rows), measured_at(figures)])


def summary(figures: Figures) -> str:
    """What the README says of captures."""
    fitted, refined = list(_judged(figures["mean"]).values())[-2:]
    exact, aligned, captured = _new_views_db(figures)
    return (
        "From pixels alone poses are off, and that limits the pictures most. Over "
        f"{len(figures['rows'])} performers who move as recorded people did (`metanerf bench "
        f"capture`: {figures['frames']} frames of {figures['size']} px in a room, unseen views, "
        f"{figures['region']}) joints are {fitted['joint_mm']:.0f} mm off, "
        f"{refined['joint_mm']:.0f} once training has refined them "
        f"({refined['joint_one_scale_mm']:.0f} with one scale a clip), and their rotations "
        f"{refined['rotation_error_deg']:.0f} degrees; `splats` from exact poses reach "
        f"{exact:.1f} dB, from captured ones {aligned:.1f} dB once each test pose is aligned with "
        f"its own picture, {captured:.1f} dB as the poses are. {measured_at(figures)}"
    )


def live(figures: Figures) -> str:
    """The live solver's time and errors."""
    step, meeting = figures["step_of_processor"], figures["in_a_meeting"]
    packet = meeting["packet_to_pose_of_processor"]
    whole = figures["with_face_and_hands"]
    late, packed = figures["late_by_60_ms"], figures["packed_to_whole_numbers"]
    rows = [
        ["a step, of one core's time", _times(step)],
        ["the same with a face and two hands", _times(whole["step_of_processor"])],
        ["face and hands alone, on a page", _times(whole["face_and_hands_on_a_page"])],
        *([words, _distances(figures[key])] for key, words in _LIVE),
        *([words, _distances(late[key])] for key, words in _LATE),
        [
            "in a meeting, a packet to a pose with feet that stand",
            f"p50 {packet['p50_ms']:.2f} ms of processor, p95 {packet['p95_ms']:.2f}",
        ],
        [
            "landmarks as they are sent, against whole numbers",
            f"{_distances(packed)}; {packed['mean_deg']:.1f}° (p95 {packed['p95_deg']:.1f}°)",
        ],
        [
            "a webcam's landmarks; with face and hands",
            " and ".join(f"{rate:.1f} kbit/s" for rate in meeting["kbit_s"].values()),
        ],
    ]
    return "\n\n".join([markdown_table(["", ""], rows), measured_at(figures)])


def _new_views_db(figures: Figures) -> list[float]:
    """With exact poses, with captured ones aligned, and with captured ones as they are."""
    worth = figures["mean"]["accuracy"]
    return [worth[name]["psnr_novel_view"] for name in ("exact", "captured_aligned", "captured")]


def _judged(row: Figures) -> dict[str, Figures]:
    """The stages that were held against the truth: those of the fit, then what training left."""
    return {name: one for name, one in row["stages"].items() if "joint_mm" in one}


def _degrees(row: Figures) -> str:
    return f"{row['rotation_error_deg']:.1f}°"


def _decibels(accuracy: Figures) -> str:
    return f"{accuracy['psnr_novel_view']:.1f} / {accuracy['psnr_unseen_pose']:.1f}"


def _times(row: Figures) -> str:
    return f"p50 {row['p50_ms']:.2f} ms, p95 {row['p95_ms']:.2f} ms"


def _distances(row: Figures) -> str:
    return (
        f"mean {row['mean_mm']:.0f} mm, p95 {row['p95_mm']:.0f} mm, "
        f"jitter {row['jitter_mm']:.1f} mm"
    )
