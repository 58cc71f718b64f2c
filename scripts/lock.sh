#!/usr/bin/env bash
# Writes requirements.lock: every package that metanerf and its tools need, with hashes.
# torch is left out: it is installed by version, since its builds differ from machine to machine.
set -euo pipefail
cd "$(dirname "$0")/.."
.venv/bin/python -m piptools compile -q --extra dev --generate-hashes --allow-unsafe --no-emit-index-url --no-emit-find-links \
  --no-emit-trusted-host --strip-extras --unsafe-package torch --output-file requirements.lock pyproject.toml
.venv/bin/python - <<'PY'
import re
from pathlib import Path

path = Path("requirements.lock")
text = path.read_text()
# a torch line with its hash lines would refuse every other machine's build
text = re.sub(r"^torch==.*?(?=^\S|\Z)", "", text, flags=re.M | re.S)
path.write_text(text)
PY
