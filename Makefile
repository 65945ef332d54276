# Everything on a fresh machine with Python >= 3.11 and make: `make scan`, `make test`.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
READY  := $(VENV)/.ready
DOCS   := .venv-docs

.PHONY: scan test fuzz check lint types bench docs wheel clean

scan: $(READY)  ## scan the phantom with the twin; results in out/scan
	$(BIN)/breastscan scan

# What needs the machine's whole attention comes alone, the rest side by side.
test: $(READY)  ## the whole test suite
	$(BIN)/pytest -m realtime
	$(BIN)/pytest -m "not realtime" -n auto --maxprocesses 4 --dist loadfile

fuzz: $(READY)  ## 10,000 programs and byte strings that nobody wrote, for every port of the twin
	MUJOCO_GL=$${MUJOCO_GL:-egl} $(BIN)/python -m tests.sim.controller.fuzz

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(READY)
	$(BIN)/pyright

check: lint types  ## what CI runs: lint, types, tests
	@$(MAKE) --no-print-directory test

bench: $(READY)  ## the benchmark table, own figures against named peers
	$(BIN)/python -m experiments.bench

docs: $(DOCS)/.ready  ## the documentation site, build/docs/index.html; any warning fails it
	$(DOCS)/bin/properdocs build --strict
	@echo "build/docs/index.html (its search needs a server: $(PYTHON) -m http.server -b 127.0.0.1 -d build/docs)"

wheel: $(READY)
	$(BIN)/python -m build --wheel

clean:
	rm -rf $(VENV) $(DOCS) build dist out

$(READY): pyproject.toml requirements.lock
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "Python 3.11 or newer is needed: make PYTHON=/path/to/python3.11 $(MAKECMDGOALS)"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check -r requirements.lock
	$(BIN)/pip install --quiet --disable-pip-version-check --no-deps -e .
	@touch $@

$(DOCS)/.ready: docs/site/requirements.lock
	$(PYTHON) -m venv $(DOCS)
	$(DOCS)/bin/pip install --quiet --disable-pip-version-check -r docs/site/requirements.lock
	@touch $@
