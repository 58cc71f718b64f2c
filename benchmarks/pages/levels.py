"""Tables of docs/levels.md."""

from __future__ import annotations

from benchmarks.pages.provenance import Figures, measured_at
from benchmarks.reporting.markdown import markdown_table

_PEOPLE = {
    "plain": "studio, clothes of one colour each",
    "amber": "studio, stripes and letters",
    "webcam": "real, at a webcam",
}
_SIZES = {"1/1": "as filmed", "1/2": "half"}


def levels_small(figures: Figures) -> str:
    """dB by all, half and a quarter of the splats, as filmed and at half the size."""
    rows = [
        [
            _PEOPLE[row["person"]],
            f"{row['splats']:,}",
            _SIZES[row["sides"]],
            *(f"{row[f'psnr_{share}']:.2f}" for share in ("1", "0.5", "0.25")),
        ]
        for row in figures["small"]
    ]
    head = ["person", "splats", "size", "all, dB", "half of them", "a quarter"]
    return "\n\n".join([markdown_table(head, rows), measured_at(figures)])


def levels_room(figures: Figures) -> str:
    """Pictures a second of a full room, by all splats and by the levels that are chosen, and how
    much is seen of a change."""
    rows = [
        [f"page, {row['people']} people, {row['size']} x {row['size']}", *_both(row)]
        for row in figures["page"]
    ]
    by = f"server, {figures['threads']} of its threads"
    rows += [
        [
            f"{by}, {row['people']} people of {row['splats']:,}, {row['size']} x {row['size']}",
            *_both(row),
        ]
        for row in figures["server"]
    ]
    change = figures["change"]
    told = (
        f"As somebody goes from {change['from']:,} splats to {change['to']:,} in "
        f"{change['pictures']} pictures, no picture changes by more than "
        f"{100 * change['largest_step_of_a_motion_step']:.0f} % of what a thirtieth of a second "
        "of their motion changes."
    )
    head = ["drawn by", "all splats", "by level"]
    return "\n\n".join([markdown_table(head, rows), told, measured_at(figures)])


def _both(row: Figures) -> list[str]:
    return [f"{row[f'{way}_pictures_per_second']:.1f} a second" for way in ("all", "levels")]
