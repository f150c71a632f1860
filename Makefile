# Every target builds the environment .venv itself, when it is missing or older than its description.
# Settings: PYTHON=python3.12 (the interpreter to build .venv with), ARGS="-k name" (passed to pytest),
# JOBS=1 (test processes; as many as cores, at most 4).

SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help

VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/ready
PIP := $(BIN)/python -m pip install --disable-pip-version-check --quiet --retries 10 --timeout 60 -c constraints.txt
PYTHON ?= $(shell for p in python3 python3.12 python3.11 python3.13; do \
    $$p -c 'import sys, venv; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1 && echo $$p && break; done)
BENCHES := $(patsubst benchmarks/bench_%.py,bench-%,$(sort $(wildcard benchmarks/bench_*.py)))
ARGS ?=
CASES ?=
PAGES ?=
NOTEBOOKS ?=
SECONDS ?= 60
TARGETS ?=
SEED ?= 0
JOBS ?= $(shell n=$$(getconf _NPROCESSORS_ONLN 2>/dev/null || echo 1); echo $$((n < 4 ? n : 4)))
SPREAD := -n $(JOBS) --dist worksteal

.PHONY: help env demo docs reference pages notebooks test test-wheel test-stores test-loaders test-ray slow fuzz golden bench $(BENCHES) lint clean

help:
	@echo 'make demo        from an empty registry to the cause that a real (or simulated) servo hides, and its page'
	@echo 'make docs        the documentation as a site, in site/index.html'
	@echo 'make reference   writes what the pages say of commands, files and documents, from the program (seconds)'
	@echo 'make pages       that, and runs every command on the pages and writes what is printed (minutes)'
	@echo 'make notebooks   runs the notebooks and writes their outputs (minutes)'
	@echo 'make test        the tests (on two cores, under 12 minutes); ARGS="-k name" for some of them'
	@echo 'make test-wheel  the tests that need no checkout, on the wheel in an environment of its own'
	@echo 'make test-stores  the tests of the registry, over PostgreSQL and a stand-in for S3 (minutes)'
	@echo 'make test-loaders  exported datasets, read by other projects in an environment of their own (1.6 GB)'
	@echo 'make test-ray    work on workers of Ray, in an environment of its own (70 MB)'
	@echo 'make slow        the longer runs, these three included'
	@echo 'make fuzz        odd inputs for every reader; SECONDS=3600 TARGETS=mcap,csv JOBS=2, findings under .fuzz/'
	@echo 'make golden      writes tests/golden anew (CASES=drift: some), where an answer changes on purpose'
	@echo 'make bench       every benchmark; results under benchmarks/results/'
	@for name in $(BENCHES); do echo "make $$name"; done
	@echo 'make lint        ruff and the import contract'
	@echo 'make env         only the environment in $(VENV)'
	@echo 'make clean       removes the environment, caches and build products'

env: $(STAMP)

# Tests of shared registries start a server of their own.
GET_POSTGRES := (apt-get update -q && DEBIAN_FRONTEND=noninteractive apt-get install -qy --no-install-recommends postgresql)

# hnswlib has no wheel, so it needs a C++ compiler; exact search serves where it cannot be built.
$(STAMP): pyproject.toml constraints.txt
	@if [ -z "$(PYTHON)" ]; then \
	    echo 'make: no Python of at least 3.11 with venv was found; install one, or name it: make PYTHON=/path/to/python' >&2; \
	    exit 1; \
	fi
	@$(BIN)/python -c 'import sys, pip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null \
	    || $(PYTHON) -m venv --clear $(VENV)
	@echo "installing into $(VENV) (a few minutes the first time)"
	@$(PIP) -e '.[dev]'
	@$(PIP) -e '.[hnsw]' >$(VENV)/hnswlib.log 2>&1 \
	    || echo 'hnswlib could not be built (it needs a C++ compiler; see $(VENV)/hnswlib.log): exact search serves'
	@ls /usr/lib/postgresql/*/bin/initdb >/dev/null 2>&1 || command -v initdb >/dev/null \
	    || { [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null && $(GET_POSTGRES) >$(VENV)/postgresql.log 2>&1; } \
	    || echo 'no PostgreSQL server (Debian: apt-get install postgresql): tests of shared registries are skipped'
	@touch $@

demo: $(STAMP)
	@$(BIN)/python examples/demo.py

docs: $(STAMP)
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict
	@echo 'site/index.html'

reference: $(STAMP)
	@$(BIN)/python docs/hooks/made.py

# PAGES="README.md docs/tutorial.md": some of them, in this order; each needs what those before it made.
pages: reference
	@$(BIN)/python tests/executed_pages.py $(PAGES)

notebooks: $(STAMP)
	@$(BIN)/python tests/executed_notebooks.py $(NOTEBOOKS)

# Tests are kept compiled, whatever the environment says: each process would else rewrite all of them (10 s).
test: export PYTHONDONTWRITEBYTECODE :=
test: $(STAMP)
	@$(BIN)/python -m pytest $(SPREAD) $(ARGS)

test-wheel: $(STAMP)
	@$(BIN)/python -m pytest -m 'slow or not slow' tests/test_wheel.py $(ARGS)

# Both processes start servers of their own.
test-stores: export PYTHONDONTWRITEBYTECODE :=
test-stores: $(STAMP)
	@$(BIN)/python -m pytest $(SPREAD) tests/registry --store shared $(ARGS)

# Hugging Face, DuckDB, Minari and LeRobot read what dynreg exports; they share no environment with it.
LOADERS := .venv-loaders
$(LOADERS)/ready: tests/loaders/requirements.txt tests/loaders/lerobot.txt constraints.txt
	@echo "installing into $(LOADERS) (minutes)"
	@$(PYTHON) -m venv --clear $(LOADERS)
	@$(subst $(BIN),$(LOADERS)/bin,$(PIP)) -r tests/loaders/requirements.txt
	@$(subst $(BIN),$(LOADERS)/bin,$(PIP)) --no-deps -r tests/loaders/lerobot.txt
	@touch $@

test-loaders: $(STAMP) $(LOADERS)/ready
	@$(BIN)/python -m pytest -m slow -s tests/loaders $(ARGS)

# Ray beside what .venv holds: `make test` needs none of it.
RAY := .venv-ray
$(RAY)/ready: constraints.txt | $(STAMP)
	@echo "installing into $(RAY) (a minute)"
	@$(BIN)/python -m venv --clear $(RAY)
	@there=$$($(BIN)/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))'); \
	echo "import site; site.addsitedir('$$there')" \
	    > $$($(RAY)/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/beside.pth
	@$(subst $(BIN),$(RAY)/bin,$(PIP)) -e '.[ray]'
	@touch $@

test-ray: $(RAY)/ready
	@$(RAY)/bin/python -m pytest -m 'slow or not slow' tests/executor $(ARGS)

slow: $(STAMP) test-stores
	@$(BIN)/python -m pytest -m slow $(ARGS)
	@$(if $(ARGS),,$(MAKE) --no-print-directory test-ray)

# Goes on where the last run of the same SEED ended; tests/fuzz/run.py --help has the rest.
fuzz: $(STAMP)
	@$(BIN)/python tests/fuzz/run.py --seconds $(SECONDS) --targets '$(TARGETS)' --jobs $(JOBS) --seed $(SEED) $(ARGS)

golden: $(STAMP)
	@$(BIN)/python tests/golden/write.py $(CASES)

# A benchmark that fails does not keep the others from running, but `make bench` then fails.
bench: $(STAMP)
	@failed=; for name in $(BENCHES); do $(MAKE) --no-print-directory $$name || failed="$$failed $$name"; done; \
	if [ -n "$$failed" ]; then echo "failed:$$failed" >&2; exit 1; fi

$(BENCHES): bench-%: $(STAMP)
	@mkdir -p benchmarks/results
	@echo "== benchmarks/bench_$*.py"
	@$(or $(BESIDE),$(BIN))/python benchmarks/bench_$*.py $(ARGS)

bench-executor: BESIDE := $(RAY)/bin
bench-executor: $(RAY)/ready

lint: $(STAMP)
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/lint-imports

clean:
	rm -rf $(VENV) $(LOADERS) $(RAY) build dist demo site *.egg-info .benchmarks .pytest_cache .ruff_cache .import_linter_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
