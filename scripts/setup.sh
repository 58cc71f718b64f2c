#!/usr/bin/env bash
# Sets up everything that `make demo` and `make test` need, once: virtual environment, pinned
# packages, the client's build, the renderer's compiled kernels. Run again it does nothing that is already done.
#   scripts/setup.sh          what the demo needs
#   scripts/setup.sh test     and the tools, the Chromium and the servers that the tests need
set -euo pipefail
cd "$(dirname "$0")/.."
# what is imported here is kept compiled, which is seconds for each process after
unset PYTHONDONTWRITEBYTECODE

fail() { printf 'setup: %s\n' "$1" >&2; exit 1; }

python_for_venv() {
  local candidate
  for candidate in "${PYTHON:-}" python3.11 python3.12 python3; do
    [ -n "$candidate" ] && command -v "$candidate" >/dev/null || continue
    "$candidate" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 12))' 2>/dev/null \
      && { echo "$candidate"; return; }
  done
  fail "Python 3.11 or 3.12 is needed and was not found; install it or set PYTHON=/path/to/python"
}

# PyPI's torch for Linux brings gigabytes of CUDA along; where there is no such card the CPU build serves
torch_index() {
  [ "$(uname -s)" = Linux ] && ! command -v nvidia-smi >/dev/null || return 0
  echo "--extra-index-url https://download.pytorch.org/whl/cpu --retries 1"
}

# $1: requirements.lock, or requirements-dev.lock, which holds all of it and more
install_python() {
  local lock=$1 installed=.venv/.installed wanted
  wanted=$(cat "$lock" pyproject.toml | sha256sum)
  # tests' packages serve the demo too: what is there stays
  grep -qsx "$wanted" "$installed" && return
  [ -x .venv/bin/python ] || "$(python_for_venv)" -m venv .venv
  echo "setup: installing Python packages (about a minute)"
  # what is imported is compiled then; of 17,000 files that is the smaller part
  # torch by version alone: its builds differ from machine to machine, so no hash can be pinned
  # shellcheck disable=SC2046  # several words, or none
  .venv/bin/python -m pip install -qq --disable-pip-version-check --no-compile $(torch_index) torch==2.13.0
  .venv/bin/python -m pip install -q --disable-pip-version-check --no-compile --no-deps --require-hashes -r "$lock"
  .venv/bin/python -m pip install -q --disable-pip-version-check --no-deps --no-build-isolation -e .
  cat requirements.lock pyproject.toml | sha256sum > "$installed"
  echo "$wanted" >> "$installed"
}

build_client() {
  local stamp=client/dist/.built wanted
  wanted=$(cd client && find . -path ./node_modules -prune -o -path ./dist -prune -o -type f -print0 | sort -z | xargs -0 sha256sum | sha256sum)
  [ -f "$stamp" ] && [ "$(cat "$stamp")" = "$wanted" ] && return
  command -v npm >/dev/null || fail "npm (Node 20 or newer) is needed to build the page; install Node.js"
  echo "setup: building the page"
  (cd client && npm ci --no-audit --no-fund --loglevel=error && npm run build --silent)
  echo "$wanted" > "$stamp"
}

draw_once() { .venv/bin/python -c "from renderer.scene_renderer import warm_up; warm_up()"; }
fit_once() { .venv/bin/python -c "from capture.fitting.warm_up import warm_up; warm_up()"; }
move_once() { .venv/bin/python -c "from services.live.motion.live_motion import warm_up; warm_up()"; }

# so that the first meeting is alive at once; where it is not done, the page says what it waits for
compile_renderer() {
  local stamp=.venv/.compiled wanted
  wanted=$(find renderer capture -name '*kernels.py' -print0 | sort -z | xargs -0 cat requirements.lock | sha256sum)
  [ -f "$stamp" ] && [ "$(cat "$stamp")" = "$wanted" ] && return
  echo "setup: compiling the renderer (half a minute)"
  together draw_once fit_once move_once
  echo "$wanted" > "$stamp"
}

# half a minute that tests would spend several times over: each of their processes compiles what it finds uncompiled
compile_training() {
  local stamp=.venv/.compiled-training wanted folder
  wanted=$(find scene capture renderer -name '*kernels.py' -print0 | sort -z | xargs -0 cat requirements.lock | sha256sum)
  [ -f "$stamp" ] && [ "$(cat "$stamp")" = "$wanted" ] && return
  echo "setup: compiling what trains"
  folder=$(mktemp -d)
  .venv/bin/metanerf studio --out "$folder/clip" --frames 8 --size 64 --test-cameras 1 --look plain >/dev/null
  .venv/bin/metanerf train "$folder/clip" --out "$folder/model.safetensors" --preset splats --budget 1s >/dev/null
  rm -r "$folder"
  echo "$wanted" > "$stamp"
}

can_apt() { command -v apt-get >/dev/null && [ "$(id -u)" = 0 ]; }

updated=""
apt_update_once() { [ -n "$updated" ] || apt-get update -qq && updated=yes; }

install_chromium() {
  [ -n "${CHROMIUM:-}" ] && return
  command -v chromium >/dev/null || command -v chromium-browser >/dev/null || command -v google-chrome >/dev/null && return
  echo "setup: installing Chromium for the browser tests"
  if can_apt; then
    apt_update_once && apt-get install -y -qq chromium >/dev/null
  else
    .venv/bin/python -m playwright install chromium
  fi
}

# servers of docker-compose.yml that tests run as they are deployed, and what lays networks between them;
# without them those tests are skipped
install_servers() {
  command -v turnserver >/dev/null && command -v caddy >/dev/null && command -v promtool >/dev/null \
    && command -v ip >/dev/null && return
  can_apt || return 0
  echo "setup: installing the servers that the deployment's tests run"
  apt_update_once && apt-get install -y -qq --no-install-recommends coturn caddy prometheus iproute2 >/dev/null
}

# the S3 store of the tests has an environment of its own: it takes no python-dateutil of version 4
install_s3() {
  command -v moto_server >/dev/null || [ -x .venv/bin/moto_server ] && return
  echo "setup: installing the S3 store that tests run"
  .venv/bin/python -m venv .venv/s3
  .venv/s3/bin/pip install -q --disable-pip-version-check --no-compile 'moto[server]==5.2.1'
  ln -sf ../s3/bin/moto_server .venv/bin/moto_server
}

demo_environment() { install_python requirements.lock; compile_renderer; }
# without apt, the Python environment brings Chromium
test_environment() {
  install_python requirements-dev.lock
  together compile_renderer compile_training install_s3
  can_apt || install_chromium
}
system_packages() { if can_apt; then install_chromium; install_servers; fi; }

# each waits for another registry or for one core: all at once. Fails where one does.
together() {
  local started=() step status=0
  for step in "$@"; do "$step" & started+=($!); done
  for step in "${started[@]}"; do wait "$step" || status=1; done
  return "$status"
}

if [ "${1:-}" = test ]; then
  together build_client test_environment system_packages
else
  together build_client demo_environment
fi
