"""Live look on real people and lifelike ones, as docs/live-look.md shows it."""

from __future__ import annotations

from benchmarks import look_cost as cost
from benchmarks.lifelike_look.measure import (
    AIM,
    BEHIND_DEG,
    BESIDE_DEG,
    FLICKER_DEG,
    MUST,
    MUST_BEHIND,
    MUST_FLICKER,
)
from benchmarks.look_end import MUST_GONE_MS
from benchmarks.look_sender import AIM_CORES, MUST_CORES
from benchmarks.pages.provenance import Figures, measured_at
from benchmarks.real import live_look as real
from benchmarks.reporting.markdown import markdown_table

_PLACES = (("webcam", "at the webcam"), ("other_cameras", "22 and 56 degrees beside"))
_PX = f"{cost.SIZE} x {cost.SIZE} px"
_PARTS = ("body", "face", "hands")


def live_look(figures: Figures) -> str:
    """What was measured, the table, and where it was measured."""
    lpips, size = figures["lpips"].removesuffix(".pth"), figures["picture_px"]
    description = (
        f"LPIPS on `{lpips}` (and PSNR, dB) of crops of other clips than the one trained on, "
        f"pictures of at most {size} px, {figures['pictures_a_second']:g} a second, by the model "
        "alone -> with live look (`metanerf bench live-look`). At the webcam's place "
        f"{real.MUST:g} is the limit for body and face, {real.AIM:g} the aim; from beside, "
        f"{real.MUST_BESIDE:g} and {real.AIM_BESIDE:g} of the model alone. Face points: how far "
        "the landmarks of a face are from where the frame has them, in the mean, % of what the "
        "eyes are apart (some 15 px of a picture of 256 px, where 2 px, the limit, are 13 %):"
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
            points = " -> ".join(f"{one['face']['points_percent']:.1f}" for one in (model, live))
            spent = f"{case['picture_ms']:.0f}"
            rows.append([name, f"{title} ({live['frames']})", *parts, points, flicker, spent])
    heads = ["person", "seen from (frames)", *_PARTS, "face points, %"]
    heads += ["flicker, of the model's", "ms a picture"]
    parts = [description, markdown_table(heads, rows)]
    if "lifelike" in figures:  # figures of before have none
        parts += _lifelike(figures["lifelike"])
    if "learning" in figures:
        parts += _learning(figures["learning"])
    return "\n\n".join([*parts, measured_at(figures)])


def _lifelike(figures: Figures) -> list[str]:
    """Of lifelike performers: what is told and the table."""
    limits = ", ".join(f"{share:g} from {degrees:g} degrees" for degrees, share in MUST.items())
    aims = ", ".join(f"{share:g}" for share in AIM.values())
    description = (
        "Lifelike performers (MakeHuman's skins and garments), who are drawn from beside their "
        "webcam as they truly are: trained on one turn, then seen by a webcam of "
        f"{' x '.join(map(str, figures['webcam_px']))} px through the product's own landmarks, "
        "live motion, cut-outs and VP8. LPIPS of the body (in brackets of the hand or the face), "
        "with live look as a share of that without it, in the pose that the landmarks give; after "
        "the stroke as a share of that of the model in the pose that live look aligned: what its "
        f"colours alone bring. The limits are {limits} (the aims {aims}), {MUST_BEHIND:g} from "
        f"beyond 75 degrees, and, in the same pose, {MUST_FLICKER:g} for flicker:"
    )
    rows = []
    for name, one in figures["cast"].items():
        for what, places in one["performances"].items():
            beside = [_shares(places[f"{degrees:g}"]) for degrees in BESIDE_DEG]
            behind = " / ".join(
                f"{max(_share(places[f'{degrees:g}'], 'body', of) for degrees in BEHIND_DEG):.2f}"
                for of in ("off", "model")
            )
            flicker = " / ".join(
                f"{_share(places[f'{degrees:g}'], 'flicker', 'model'):.2f}"
                for degrees in FLICKER_DEG
            )
            off = places["0"]["off"]["body"]
            rows.append([name, what, f"{off:.3f}", *beside, behind, flicker])
    heads = [
        "performer",
        "what they do",
        "without it at 0 degrees",
        *(f"{degrees:g} degrees" for degrees in BESIDE_DEG),
        "worst beyond 75",
        f"flicker at {' / '.join(f'{degrees:g}' for degrees in FLICKER_DEG)}",
    ]
    # a run of these performers alone says which it was
    own = [measured_at(figures)] if "commit" in figures else []
    return [description, markdown_table(heads, rows), *own]


def _shares(place: Figures) -> str:
    body, part = (_share(place, figure, "off") for figure in ("body", "part"))
    return f"{body:.2f} ({part:.2f}) / {_share(place, 'body', 'model'):.2f}"


def _share(place: Figures, figure: str, of: str) -> float:
    return place["live"][figure] / place[of][figure]


def _learning(cases: Figures) -> list[str]:
    """What a model gains by what its live look kept: what is told and a row a person."""
    description = (
        "*Learn from it*: by the model alone, before -> after it learnt from what the server kept "
        "while the first half of each other clip played as a webcam's video; on the second halves, "
        "each in the pose that its own picture aligns it in. The juggler's other clip is the rest "
        "of his own, in which he turns away. Of the clip: how much worse frames of it that were "
        "held out come out, dB of the body (below 0: better):"
    )
    rows = []
    for name, case in cases.items():
        before, after, held = case["before"], case["after"], case["held_to"]
        parts = [_change(before[part], after[part]) for part in ("body", "face")]
        lost = "-" if held is None else f"{held['lost_db']['body']:+.2f}"
        of_the_clip = "too much: the old model stays" if case["forgot"] else lost
        kept = f"{case['kept']} of {case['seen']}"
        rows.append([name, kept, str(before["frames"]), *parts, of_the_clip])
    heads = ["person", "pictures kept, of", "frames judged", "body", "face", "of the clip"]
    return [description, markdown_table(heads, rows)]


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
    parts = [markdown_table(heads, rows)]
    if "sender" in figures:  # figures of before have none
        parts.append(_sender(figures["sender"]))
    if "gone" in figures:
        parts += _gone(figures["gone"])
    return "\n\n".join([*parts, measured_at(figures)])


def _sender(figures: Figures) -> str:
    return (
        f"Its sender's page takes {figures['cores_for_live_look']:.2f} of a core for it, beside "
        f"finding landmarks ({figures['with_live_look']:.0f} a second, "
        f"{figures['landmarks_per_second']:.0f} without; limit {MUST_CORES:.2f}, aim "
        f"{AIM_CORES:.2f})."
    )


def _gone(ends: list[Figures]) -> list[str]:
    """From the switch to the first picture in trained colours, a row a way of drawing."""
    rows = [
        [
            f"the {row['drawn_by']}",
            *(_ms(row[name]) for name in ("median_ms", "worst_ms")),
            f"{MUST_GONE_MS:g} ms",
            f"{row['told']} of {row['turns']}",
            f"{row['load']:g}",
        ]
        for row in ends
    ]
    heads = ["switched off to gone, drawn by", "median", "worst", "must", "turns told", "load"]
    return [
        "From the switch on the sender's page until another page draws trained colours, or shows "
        "the server's picture in them; browser, service and both pages share the cores, for which "
        "so many processes wait (load):",
        markdown_table(heads, rows),
    ]


def _ms(value: float | None) -> str:
    return "-" if value is None else f"{value:.0f} ms"


def look_cost(figures: Figures) -> str:
    """What it costs the server and the line up, a row a figure."""
    drawn = []
    for row, must, aim in zip(figures["rows"], cost.MUST_DRAWN_MS, cost.AIM_DRAWN_MS, strict=True):
        added, alone = row["drawn_ms"]["added"], row["drawn_ms"]["alone"]
        what = f"{row['splats']:,} splats: added to a performer's {alone:.1f} ms, {_PX}"
        drawn.append([what, f"{added:.1f} ms", f"{must:g} ms", f"{aim:g} ms"])
    coloured = " and ".join(f"{row['coloured_ms']:.0f}" for row in figures["rows"])
    rows = [
        *drawn,
        ["their colours found from a picture, beside the drawing", f"{coloured} ms", "-", "-"],
        [
            "a frame decoded",
            f"{figures['decoded_ms']:.1f} ms",
            f"{cost.MUST_DECODED_MS:g} ms",
            f"{cost.AIM_DECODED_MS:g} ms",
        ],
        *_decoder_start(figures),
        [
            "motion and pictures up",
            f"{figures['up_mbit_s']:.2f} Mbit/s",
            f"{cost.MUST_UP_MBIT_S:.2f}",
            f"{cost.AIM_UP_MBIT_S:.2f}",
        ],
    ]
    return "\n\n".join(
        [markdown_table(["what", "takes", "must", "aim"], rows), measured_at(figures)]
    )


def _decoder_start(figures: Figures) -> list[list[str]]:
    """What decodes a sender's frames, from nothing to their first picture."""
    if "decoder_start" not in figures:  # figures of before have none
        return []
    start = figures["decoder_start"]
    took = f"{start['ms']:.0f} ms, {start['processor_ms']:.0f} ms of a processor"
    return [["the process that decodes, once a sender, to its first picture", took, "-", "-"]]


def _change(model: Figures, live: Figures) -> str:
    if live.get("lpips") is None:
        return "-"
    lpips = f"{model['lpips']:.3f} -> {live['lpips']:.3f}"
    return f"{lpips} ({model['psnr']:.1f} -> {live['psnr']:.1f})"
