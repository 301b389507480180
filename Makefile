# make demo   installs and runs the whole job on the shipped simulated recordings; leaves out/demo/report.html
# make test   installs and runs all tests
# make quick  installs and runs the tests of a minute: not those marked slow, and without the run-time checks of shapes
# make view   installs and plays a simulated recording with its forecasts in the browser
# make dist   builds the source distribution and the wheel in dist/, and has them and the conda recipe checked
# make docs-version   builds the pages as this version's on the local branch gh-pages, beside those of others
# make versions   installs on each Python 3.11 to 3.13 that is there, and in the lowest versions, runs the quick tests, and compares forecasts
# make fuzz       fuzzes the readers of csv, json and xml, led by the code they reach, for SECONDS each (1200)
# make soak   installs and runs the live service under load for an hour (SECONDS=300: five minutes)
# make container does in a fresh virtual environment what deploy/Dockerfile does, and tells how much [live] adds
# make attack installs and lets hostile clients loose on the live service, while others use it
# make pretrained   trains the model that the wheel brings along, from the recordings in RAMPCAST_DATA and the shipped ones
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
MINOR = $(shell sed -n 's/^version = "\([0-9]*\.[0-9]*\).*/\1/p' pyproject.toml)
# a process for each core, up to four; the tests of a module share what it made; the longest modules first (tests/conftest.py)
IN_PARALLEL := --numprocesses auto --maxprocesses 4 --dist loadscope --no-loadscope-reorder

# Where Python is told to keep no bytecode, each run of the tests would compile some 2,500 files again: half its collection.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo view test quick check versions fuzz bench bench-smoke soak attack container docs docs-version dist sample pretrained clean

demo: $(VENV)/.installed-demo
	$(BIN)/rampcast demo --out out/demo

view: $(VENV)/.installed-live
	$(BIN)/rampcast view

test: $(VENV)/.installed-dev
	$(BIN)/pytest $(IN_PARALLEL)

quick: $(VENV)/.installed-dev
	$(BIN)/pytest $(IN_PARALLEL) -m "not slow" --jaxtyping-packages=

check: $(VENV)/.installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/vulture

bench: $(VENV)/.installed-dev
	@for script in benchmarks/bench_*.py; do echo "== $$script"; $(BIN)/python $$script || exit 1; done

soak: $(VENV)/.installed-dev
	$(BIN)/python benchmarks/bench_live.py --soak $(or $(SECONDS),3600)

attack: $(VENV)/.installed-dev
	$(BIN)/python benchmarks/attack_live.py

container:
	$(PYTHON) deploy/try_out.py

versions:
	@for python in $(or $(PYTHONS),python3.11 python3.12 python3.13); do .ci/version $$python newest || exit 1; done
	$(PYTHON) benchmarks/same_over_pythons.py .venv-versions/*-newest/bin/python
	.ci/version python3.11 lowest

fuzz: $(VENV)/.installed-fuzz
	$(BIN)/pip install --quiet --disable-pip-version-check pytest hypothesis
	@for suffix in csv json xml; do $(BIN)/python -m tests.fuzz.readers $$suffix -max_total_time=$(or $(SECONDS),1200) || exit 1; done

bench-smoke: $(VENV)/.installed-dev
	$(BIN)/pytest tests/test_benchmarks.py

docs: $(VENV)/.installed-docs
	$(BIN)/python docs/scripts/cli_reference.py
	$(BIN)/python docs/scripts/formats_pages.py
	$(BIN)/mkdocs build --strict

docs-version: $(VENV)/.installed-docs
	$(BIN)/python docs/scripts/cli_reference.py
	$(BIN)/python docs/scripts/formats_pages.py
	PATH=$(BIN):$$PATH $(BIN)/mike deploy --alias-type=copy --update-aliases $(MINOR) latest
	PATH=$(BIN):$$PATH $(BIN)/mike set-default latest

dist: $(VENV)/.installed-dev $(VENV)/.installed-dist
	rm -rf dist
	$(BIN)/python -m build --outdir dist
	$(BIN)/python -m twine check --strict dist/*
	$(BIN)/pytest tests/test_distribution.py

sample: $(VENV)/.installed-dev
	$(BIN)/python -m rampcast.simulate sample src/rampcast/simulate/data

pretrained: $(VENV)/.installed-dev
	$(BIN)/python -m rampcast.benchmark.pretrained

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
