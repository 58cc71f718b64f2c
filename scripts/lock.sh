#!/usr/bin/env bash
# Pins every package with its hash, in three files:
#   requirements.lock           what metanerf runs on, and tells traces with
#   requirements-cluster.lock   the same and Ray, for jobs on a cluster
#   requirements-dev.lock       all of that and what its tests, tools and body asset are made with
# torch is left out of all: it is installed by version, since its builds differ from machine to machine.
set -euo pipefail
cd "$(dirname "$0")/.."

pin() {
  local file=$1; shift
  .venv/bin/python -m piptools compile -q --generate-hashes --allow-unsafe --no-emit-index-url --no-emit-find-links \
    --no-emit-trusted-host --strip-extras --unsafe-package torch --output-file "$file" "$@" pyproject.toml
  .venv/bin/python - "$file" <<'PY'
import re
import sys
from pathlib import Path

path = Path(sys.argv[1])
text = path.read_text()
# a torch line with its hash lines would refuse every other machine's build
text = re.sub(r"^torch==.*?(?=^\S|\Z)", "", text, flags=re.M | re.S)
path.write_text(text)
PY
}

pin requirements.lock --extra tracing
pin requirements-cluster.lock --extra tracing --extra cluster --constraint requirements.lock
pin requirements-dev.lock --extra tracing --extra cluster --extra dev --constraint requirements-cluster.lock
