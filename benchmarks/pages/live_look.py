"""Live look on real people, as docs/live-look.md shows it."""

from __future__ import annotations

from benchmarks.pages.provenance import Figures, measured_at
from benchmarks.real.live_look import AIM, AIM_BESIDE, MUST, MUST_BESIDE
from benchmarks.reporting.markdown import markdown_table

_PLACES = (("webcam", "at the webcam"), ("other_cameras", "22 and 56 degrees beside"))
_PARTS = ("body", "face", "hands")


def live_look(figures: Figures) -> str:
    """What was measured, the table, and where it was measured."""
    lpips, size = figures["lpips"].removesuffix(".pth"), figures["picture_px"]
    description = (
        f"LPIPS on `{lpips}` (and PSNR, dB) of crops of other clips than the one trained on, "
        f"pictures of at most {size} px, {figures['pictures_a_second']:g} a second, by the model "
        "alone -> with live look (`metanerf bench live-look`). At the webcam's place "
        f"{MUST:g} is the limit for body and face, {AIM:g} the aim; from beside, "
        f"{MUST_BESIDE:g} and {AIM_BESIDE:g} of the model alone:"
    )
    rows = []
    for name, case in figures["cases"].items():
        for place, title in _PLACES:
            if place not in case:
                continue
            model, live = case[place]["model"], case[place]["live"]
            parts = [_change(model[part], live[part]) for part in _PARTS]
            flicker = (
                "-" if live["flicker"] is None else f"{live['flicker'] / model['flicker']:.2f}"
            )
            rows.append(
                [name, f"{title} ({live['frames']})", *parts, flicker, f"{case['picture_ms']:.0f}"]
            )
    heads = ["person", "seen from (frames)", *_PARTS, "flicker, of the model's", "ms a picture"]
    return "\n\n".join([description, markdown_table(heads, rows), measured_at(figures)])


def local_look(figures: Figures) -> str:
    """What it costs a page that draws, a row a number of people."""
    rows = [
        [
            str(row["people"]),
            f"{row['pictures_per_second']:.0f}",
            f"{row['with_live_look']:.0f}",
            f"{row['changes_per_second']:.1f}",
            f"{row['kbit_per_second'] / 1e3:.2f}",
        ]
        for row in figures["rows"]
    ]
    heads = [
        "people, all with live look",
        "pictures a second without it",
        "with it",
        "new colours a second, each",
        "Mbit/s down",
    ]
    return "\n\n".join([markdown_table(heads, rows), measured_at(figures)])


def _change(model: Figures, live: Figures) -> str:
    if live.get("lpips") is None:
        return "-"
    lpips = f"{model['lpips']:.3f} -> {live['lpips']:.3f}"
    return f"{lpips} ({model['psnr']:.1f} -> {live['psnr']:.1f})"
