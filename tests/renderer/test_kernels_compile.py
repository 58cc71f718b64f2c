"""Every Triton kernel becomes code for GPUs that need not be here."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path


def test_the_kernels_compile_to_tensor_core_instructions():
    """For Ampere (sm_80) and Hopper (sm_90)."""
    script = Path(__file__).with_name("compile_kernels.py")
    done = subprocess.run(
        [sys.executable, str(script)],
        capture_output=True,
        text=True,
        check=False,
        env={"PATH": "/usr/bin:/bin", "PYTHONPATH": str(Path.cwd()), "HOME": str(Path.home())},
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["sm_80", "sm_90"]
