"""What a CUDA device brings, as docs/gpu.md shows it."""

from __future__ import annotations

from benchmarks.pages.provenance import Figures, measured_at
from benchmarks.reporting.markdown import markdown_table


def gpu(figures: Figures) -> str:
    """What was measured, p50 with p95 in brackets, and where."""
    splats = [
        [
            f"{row['performers']} x {row['splats']:,}",
            str(row["size"]),
            *(_milliseconds(row, f"{by}_") for by in ("device", "gsplat", "host")),
        ]
        for row in figures["splats"]
    ]
    fields = [
        [str(row["size"]), _milliseconds(row), f"{row['frames_a_second']:g}"]
        for row in figures["fields"]
    ]
    first = figures["fields"][0]
    training = [
        [
            f"{row['budget_s']:g} s",
            f"{row['steps']:,}",
            *(f"{row[f'psnr_{what}_body_crop']:.1f}" for what in ("novel_view", "unseen_pose")),
        ]
        for row in figures["training"]
    ]
    side = figures["training_px"]
    return "\n\n".join(
        [
            f"On one {figures['device']} with torch {figures['machine']['torch']}, "
            "ms at p50 (p95).",
            markdown_table(
                ["splats", "px", "on the device", "gsplat", "in the host's memory"], splats
            ),
            f"The paper's field with all exact speed-ups: {first['db_to_slow']:g} dB to the slow "
            f"path, which takes {first['slow_ms']:.0f} ms at {first['size']} px.",
            markdown_table(["px", "ms", "frames a second"], fields),
            f"The same field trained from nothing, {figures['frames']} frames of {side} x {side}, "
            "the published schedule of 150,000 steps shrunk to the time:",
            markdown_table(["time", "steps", "dB, unseen views", "unseen poses"], training),
            measured_at(figures),
        ]
    )


def _milliseconds(row: Figures, prefix: str = "") -> str:
    if f"{prefix}p50_ms" not in row:
        return "-"
    return f"{row[f'{prefix}p50_ms']:.2f} ({row[f'{prefix}p95_ms']:.2f})"
