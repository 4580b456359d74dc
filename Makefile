# `make demo`, `make test`, `make check` each build .venv when it is missing or out of date.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
STAMP  := $(VENV)/.complete

.PHONY: help demo test check verify lock clean
.DEFAULT_GOAL := help

help:  ## this list
	@awk -F ':.*## ' '/^[a-z]+:.*## / {printf "make %-8s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

$(STAMP): requirements.lock requirements-dev.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit("contactd needs Python 3.11 or newer, not " + sys.version.split()[0] + \
	  " (choose another: make PYTHON=python3.12 ...)" if sys.version_info < (3, 11) else 0)'
	@$(PYTHON) -c 'import ensurepip' || { echo "this Python has no venv: apt install python3-venv"; exit 1; }
	$(PYTHON) -m venv --clear $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check --no-deps -r requirements.lock -r requirements-dev.lock
	$(BIN)/pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $@

demo: $(STAMP)  ## the paper's third experiment on a simulated arm, about 30 s
	@$(BIN)/contactd demo

test: $(STAMP)  ## all tests, under 3 minutes
	$(BIN)/python -m pytest -q

check: $(STAMP)  ## ruff, mypy (strict), import layers
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

verify: $(STAMP)  ## compare our URDF with the public Romeo description (downloads 400 MB)
	$(BIN)/pip install --quiet --disable-pip-version-check --no-deps example-robot-data
	$(BIN)/python -m pytest -q -m verify

lock:  ## resolve the dependencies anew and write both lock files (names and versions)
	rm -rf build/lock && $(PYTHON) -m venv build/lock
	build/lock/bin/pip install --quiet .
	build/lock/bin/pip freeze --exclude contactd > requirements.lock
	build/lock/bin/pip install --quiet ".[bench,dev]" hatchling
	build/lock/bin/pip freeze --exclude contactd | grep -vxFf requirements.lock > requirements-dev.lock

clean:  ## remove the environment and everything that was built
	rm -rf $(VENV) build dist bench/out .mypy_cache .pytest_cache .ruff_cache .hypothesis .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
