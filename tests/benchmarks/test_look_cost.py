"""What live look costs is measured on frames that the server reads, and told beside its limits."""

from __future__ import annotations

import time

from benchmarks.local_look import sent_by
from benchmarks.look_cost import coloured_ms, decoded_ms, decoder_start, drawn_ms, up_mbit_s
from benchmarks.pages.live_look import look_cost
from benchmarks.serve import surface_model
from services.live.look.packets import Whose


def test_costs_are_measured_and_told():
    model = surface_model(600)
    sent = sent_by(model, Whose(0, 1, 1))
    up = up_mbit_s(sent)
    # 160 kbit/s of pictures, 86 of motion, and what is round each packet
    assert 0.2 < up < 0.4
    decoded = decoded_ms(sent, time.thread_time)
    assert 0.0 < decoded < 100.0
    start = decoder_start(sent)
    assert start["ms"] > decoded, "a process starts and loads a decoder"
    assert start["processor_ms"] > 0.0
    drawn = drawn_ms(model, time.thread_time)
    assert drawn["alone"] > 0.0
    coloured = coloured_ms(model, sent, time.thread_time)
    assert coloured > decoded
    rows = [
        {"splats": splats, "drawn_ms": {"alone": 9.0, "added": added}, "coloured_ms": 50.0}
        for splats, added in ((10_000, 0.6), (40_000, 2.3))
    ]
    machine = {"processor": "a processor", "loop_ms": 10.0}
    figures = {
        "rows": rows,
        "decoded_ms": 1.4,
        "decoder_start": {"ms": 812, "processor_ms": 430},
        "up_mbit_s": 0.27,
        "date": "2026-11-27",
        "commit": "abc",
        "uncommitted_changes": False,
        "machine": machine,
    }
    lines = look_cost(figures).splitlines()
    (forty,) = [line for line in lines if "40,000 splats" in line]
    assert [cell.strip() for cell in forty.split("|")[2:-1]] == ["2.3 ms", "5 ms", "3 ms"]
    (start_row,) = [line for line in lines if "process that decodes" in line]
    assert "812 ms, 430 ms of a processor" in start_row
