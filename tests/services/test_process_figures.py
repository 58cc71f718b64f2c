"""Figures of a process: its name, its memory with its children's, and the GPUs'."""

from __future__ import annotations

import ctypes
import subprocess
import sys
from typing import Any

import pytest
import torch
from prometheus_client import REGISTRY, CollectorRegistry, generate_latest

from services.process_figures import (
    GpuFigures,
    GpuMemory,
    describe_process,
    gpu_driver,
    gpu_memory,
    resident_bytes,
)

HOLD_64_MIB = (
    "import sys; held = bytes(range(256)) * (1 << 18); print(flush=True); sys.stdin.read()"
)


def test_a_process_has_one_name_the_last():
    for name in ("one", "another"):
        describe_process(name)
    assert REGISTRY.get_sample_value("metanerf_node_info", {"node_id": "another"}) == 1
    assert REGISTRY.get_sample_value("metanerf_node_info", {"node_id": "one"}) is None


def test_memory_is_that_of_the_process_and_of_those_below_it():
    before = resident_bytes()
    assert before > 10 << 20
    parent = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {HOLD_64_MIB!r}])"
    command = [sys.executable, "-c", parent]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as below:
        assert below.stdin is not None
        assert below.stdout is not None
        below.stdout.readline()
        assert resident_bytes() > before + (60 << 20)
        below.stdin.close()
    assert resident_bytes() < before + (60 << 20)


def test_gpus_and_their_memory_are_what_cuda_says():
    totals = [torch.cuda.mem_get_info(index)[1] for index in range(torch.cuda.device_count())]
    read = gpu_memory(gpu_driver())
    # the driver counts what it keeps for itself
    assert [one.total for one in read] == pytest.approx(totals, rel=0.05)
    assert all(0 < one.used <= one.total for one in read)


class Driver:
    """NVML of two GPUs, of which the first one is lost."""

    def nvmlDeviceGetCount_v2(self, count: Any) -> int:  # noqa: N802
        ctypes.cast(count, ctypes.POINTER(ctypes.c_uint))[0] = 2
        return 0

    def nvmlDeviceGetHandleByIndex_v2(self, index: int, device: Any) -> int:  # noqa: N802
        ctypes.cast(device, ctypes.POINTER(ctypes.c_void_p))[0] = 100 + index
        return 15 if index == 0 else 0

    def nvmlDeviceGetMemoryInfo(self, device: Any, memory: Any) -> int:  # noqa: N802
        assert device.value == 101
        # nvmlMemory_t: total, free, used
        ctypes.cast(memory, ctypes.POINTER(ctypes.c_ulonglong * 3))[0][:] = [80, 50, 30]
        return 0


def test_a_gpu_that_is_lost_has_no_figure():
    assert gpu_memory(Driver()) == [GpuMemory(used=30, total=80)]
    assert gpu_memory(None) == []


def test_memory_of_gpus_is_read_at_each_scrape():
    registry, read = CollectorRegistry(), []
    registry.register(GpuFigures(lambda: read))
    assert "metanerf_gpu_memory_bytes{" not in generate_latest(registry).decode()
    read.append(GpuMemory(used=30, total=80))
    text = generate_latest(registry).decode()
    assert 'metanerf_gpu_memory_bytes{gpu="0",kind="used"} 30.0' in text
    assert 'metanerf_gpu_memory_bytes{gpu="0",kind="total"} 80.0' in text
