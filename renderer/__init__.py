"""Block 3: the models of a person, their training, evaluation, serving and composition."""

import os

# OpenMP's threads spin while they wait, which starves every other process where cores are few; the
# runtime reads this once, when numba or torch first start a thread.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
