.PHONY: demo test unit check format lock pin audit setup
PYTEST = .venv/bin/python -m pytest

# where it is set, each process would compile anew what it imports: seconds, hundreds of times over
unexport PYTHONDONTWRITEBYTECODE

# The main job: everything is set up, then the meeting opens in the browser.
demo: setup
	.venv/bin/metanerf demo $(ARGS)

# Everything that continuous integration checks: format, lint, types, imports, all tests.
# Tests in Python wait for servers and processes a part of their time, in which checks run. A browser's
# leave nothing of a core to others.
test: setup-test
	$(MAKE) --jobs=3 --keep-going check test-page test-python; \
	rest=$$?; $(PYTEST) tests/e2e tests/benchmarks -m e2e $(ARGS) && exit $$rest

# Tests without a browser, without servers and without long trainings: under two minutes, while you work.
unit: setup-test
	$(PYTEST) -m "not e2e and not server and not slow" -x -q $(ARGS)

check:
	.venv/bin/ruff format --check .
	.venv/bin/ruff check .
	.venv/bin/pyright
	.venv/bin/lint-imports
	cd client && npm run check --silent

.PHONY: test-page test-python
test-page:
	cd client && npm test --silent

test-python:
	$(PYTEST) -m "not e2e" -n 2 --dist loadfile --no-loadscope-reorder $(ARGS)

format:
	.venv/bin/ruff format .
	.venv/bin/ruff check --fix .

# Pins every package but torch with its hash (one file to run, one to test); run it after a change of dependencies.
lock:
	scripts/lock.sh

# Pins the images that we run on and build from by today's digests, where their registries can be reached.
pin: setup
	.venv/bin/python -m tools.pin_images

# Advisories about the packages that we use, where their registries tell them, and bandit over our Python.
audit: setup-test
	.venv/bin/python -m tools.audit

setup:
	@scripts/setup.sh

.PHONY: setup-test
setup-test:
	@scripts/setup.sh test
