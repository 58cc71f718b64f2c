"""Figures for Prometheus of any process of ours: what it is called, its memory, the GPUs'."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from prometheus_client import REGISTRY, Gauge
from prometheus_client.metrics_core import GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

NODE = Gauge("metanerf_node_info", "1, with the name of this process in logs.", ["node_id"])
MEMORY = Gauge(
    "metanerf_memory_bytes", "Resident memory of this process and of its children, bytes."
)
_NVML = "libnvidia-ml.so.1"


def describe_process(node_id: str) -> None:
    """Have the figures say that this process is called `node_id`."""
    NODE.clear()
    NODE.labels(node_id).set(1)
    MEMORY.set_function(resident_bytes)


def resident_bytes() -> int:
    """Of this process and all below it (proc(5)); what they share counts for each. 0 where there is
    no such file system."""
    pages, waiting = 0, [os.getpid()]
    while waiting:
        process = Path("/proc") / str(waiting.pop())
        try:
            pages += int((process / "statm").read_text().split()[1])
            for thread in (process / "task").iterdir():
                waiting += map(int, (thread / "children").read_text().split())
        except OSError:  # it has just ended
            continue
    return pages * os.sysconf("SC_PAGE_SIZE")


class GpuMemory(NamedTuple):
    """Of one GPU, whoever uses it, bytes."""

    used: int
    total: int


class _NvmlMemory(ctypes.Structure):
    """`nvmlMemory_t`."""

    _fields_ = (
        ("total", ctypes.c_ulonglong),
        ("free", ctypes.c_ulonglong),
        ("used", ctypes.c_ulonglong),
    )


@cache
def gpu_driver() -> ctypes.CDLL | None:
    """NVIDIA's library of figures (NVML), ready to be asked; None where there is no driver."""
    try:
        library = ctypes.CDLL(_NVML)
    except OSError:
        return None
    return None if library.nvmlInit_v2() else library


def gpu_memory(driver: Any) -> list[GpuMemory]:
    """Of each GPU that this process sees, by `gpu_driver`: that needs no context of CUDA, which
    would itself take half a gigabyte. One that does not answer is left out."""
    count = ctypes.c_uint()
    if driver is None or driver.nvmlDeviceGetCount_v2(ctypes.byref(count)):
        return []
    read = []
    for index in range(count.value):
        device, memory = ctypes.c_void_p(), _NvmlMemory()
        if driver.nvmlDeviceGetHandleByIndex_v2(index, ctypes.byref(device)):
            continue
        if not driver.nvmlDeviceGetMemoryInfo(device, ctypes.byref(memory)):
            read.append(GpuMemory(memory.used, memory.total))
    return read


class GpuFigures(Collector):
    """Memory of GPUs, read at each scrape."""

    def __init__(self, read: Callable[[], list[GpuMemory]]) -> None:
        self._read = read

    def describe(self) -> Iterable[Metric]:
        """See `Collector.describe`: without it, the driver would be asked at the import."""
        return [_gpu_family()]

    def collect(self) -> Iterable[Metric]:
        """See `Collector.collect`."""
        family = _gpu_family()
        for index, memory in enumerate(self._read()):
            for kind, size in memory._asdict().items():
                family.add_metric([str(index), kind], size)
        return [family]


def _gpu_family() -> GaugeMetricFamily:
    return GaugeMetricFamily(
        "metanerf_gpu_memory_bytes",
        "Memory of each GPU, used by anybody and in total, bytes.",
        labels=["gpu", "kind"],
    )


REGISTRY.register(GpuFigures(lambda: gpu_memory(gpu_driver())))
