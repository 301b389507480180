# make demo   installs and runs the whole job on the shipped simulated recordings; leaves out/demo/report.html
# make test   installs and runs all tests
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: demo test check bench docs sample clean

demo: $(VENV)/.installed-demo
	$(BIN)/rampcast demo --out out/demo

test: $(VENV)/.installed-dev
	$(BIN)/pytest

check: $(VENV)/.installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: $(VENV)/.installed-dev
	@for script in benchmarks/bench_*.py; do echo "== $$script"; $(BIN)/python $$script || exit 1; done

docs: $(VENV)/.installed-docs
	$(BIN)/python docs/scripts/cli_reference.py
	$(BIN)/mkdocs build --strict

sample: $(VENV)/.installed-dev
	$(BIN)/python -m rampcast.simulate sample src/rampcast/simulate/data

clean:
	rm -rf $(VENV) out site dist

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed-demo: pyproject.toml | $(BIN)/python
	$(BIN)/pip install --quiet --disable-pip-version-check --editable . --constraint constraints.txt
	@touch $@

$(VENV)/.installed-%: pyproject.toml | $(BIN)/python
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[$*]' --constraint constraints.txt
	@touch $@
