"""Every benchmark whose figures the pages show: how it is called and what it needs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from benchmarks.inputs import (
    require_browser,
    require_cuda,
    require_footage,
    require_human_assets,
    require_motion,
    require_panoramas,
    require_real_footage,
    require_webcam_clip,
)
from scene.errors import InvalidInput


@dataclass(frozen=True)
class Benchmark:
    """One command of `metanerf bench`."""

    name: str
    """Of its file of figures."""
    arguments: tuple[str, ...]
    """After `metanerf bench`."""
    needs: tuple[Callable[[], None], ...] = ()
    """Each raises InvalidInput where something is not at hand."""
    takes_backbone: bool = False
    """LPIPS is measured where its backbone is at hand."""

    def words(self, backbone: Path | None) -> list[str]:
        """The command line after `metanerf`."""
        judged = self.takes_backbone and backbone is not None
        return ["bench", *self.arguments, *(["--backbone", str(backbone)] if judged else [])]

    def missing(self) -> str | None:
        """What it lacks on this machine."""
        for require in self.needs:
            try:
                require()
            except InvalidInput as error:
                return str(error)
        return None


CATALOGUE = (
    Benchmark("reading", ("reading",)),
    Benchmark("live-capture", ("live-capture",), (require_browser,)),
    Benchmark("masks", ("masks",)),
    Benchmark("enrolment", ("enrolment",), (require_webcam_clip,)),
    Benchmark("local-view", ("local-view",), (require_browser,)),
    Benchmark("local-look", ("local-look",), (require_browser, require_webcam_clip)),
    Benchmark("look-cost", ("look-cost",)),
    Benchmark("serve", ("serve",), (require_browser,)),
    Benchmark("meeting", ("meeting",), (require_browser, require_webcam_clip)),
    Benchmark("renderers", ("renderers",)),
    Benchmark("load", ("load",)),
    Benchmark("faults", ("faults",)),
    Benchmark("lipsync", ("lipsync",), (require_browser,)),
    Benchmark("distil", ("distil",)),
    Benchmark("relight", ("relight",), (require_panoramas,)),
    Benchmark("expressions", ("expressions",)),
    Benchmark("expressions-found", ("expressions-found",), (require_human_assets,)),
    Benchmark("covered-torso", ("covered-torso",), (require_human_assets,)),
    Benchmark("two-cameras", ("two-cameras",), (require_footage,)),
    Benchmark("real", ("real",), (require_real_footage,)),
    Benchmark("live-look", ("live-look",), (require_real_footage, require_human_assets)),
    Benchmark("live-head", ("live-head",), (require_real_footage,)),
    Benchmark("levels", ("levels",), (require_real_footage, require_browser)),
    Benchmark(
        "parsimony",
        ("parsimony",),
        (require_motion, require_human_assets, require_real_footage),
    ),
    Benchmark(
        "ablation",
        ("ablation",),
        (require_motion, require_human_assets, require_real_footage),
    ),
    Benchmark("install", ("install", "--fresh")),
    Benchmark("field-speed", ("field",)),
    Benchmark("foreign", ("foreign",), takes_backbone=True),
    Benchmark("kernels", ("kernels",), (require_cuda,)),
    Benchmark("gpu", ("gpu",), (require_cuda,)),
    Benchmark("paper-stability", ("paper-stability",), (require_cuda, require_motion)),
    Benchmark("lifelike", ("lifelike",), (require_motion, require_human_assets)),
    Benchmark("performers", ("performers",), (require_motion,), takes_backbone=True),
    Benchmark("train", ("train",), (require_motion,), takes_backbone=True),
    Benchmark("capture", ("capture",), (require_motion,), takes_backbone=True),
    Benchmark("stability", ("stability",), (require_motion,)),
    Benchmark("frontier", ("frontier",), takes_backbone=True),
)
"""Short ones first."""
