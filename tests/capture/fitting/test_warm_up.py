"""What is compiled before the first fit is all that fits run."""

from __future__ import annotations

import subprocess
import sys

_FIT = """
from capture.fitting import fit, kinematics_kernels
from capture.fitting.terms import flow_kernels, silhouette_kernels
from capture.fitting.warm_up import warm_up
from capture.body.model import load_body_model
from tests.capture.people import body, camera, picture, seen_by, standing

def compiled():
    kernels = (kinematics_kernels, flow_kernels, silhouette_kernels)
    found = {name: one for module in kernels for name, one in vars(module).items()}
    return {name: one.signatures for name, one in found.items() if hasattr(one, "signatures")}

warm_up()
before = compiled()
fit.LANDMARK_STEPS = fit.SILHOUETTE_STEPS = 2
motion = standing(6)
people = [seen_by(camera(64), body(), motion.pose(frame)) for frame in range(6)]
images, masks = [picture(person) for person in people], [person.mask for person in people]
fit.fit_clip(people, masks, motion.times_s, [0] * 6, load_body_model(), images=images)
print(len(before["skin"]), before == compiled())
"""


def test_a_fit_finds_everything_compiled():
    found = subprocess.run([sys.executable, "-c", _FIT], capture_output=True, text=True, check=True)
    assert found.stdout.split() == ["1", "True"]
