# make tables   the tables 1 and 2 of the paper, on the real sequences where found or downloadable
# make test     lint, types and the test suite
# make bench    speed of the solvers beside named alternatives
# make validate the longer checks: published numbers on whole datasets
# make test-server  tracking on PostgreSQL, which is installed first where apt-get can do it
# make docs     the documentation as a site, in build/docs
# make dist     the wheel and the source distribution, in dist/
# make fuzz     damaged and hostile files for every reader: FUZZ_EXAMPLES made, then FUZZ_SECONDS of each by coverage
# make format   what lint and formatting can mend by themselves
# make clean    remove the environment and everything built; outputs and data stay
PYTHON ?= python3
BIN := .venv/bin
INSTALLED := .venv/.installed

.PHONY: help tables test test-server validate bench fuzz docs dist format clean

help:
	@grep -E '^# make' Makefile | cut -c3-

$(INSTALLED): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "Python 3.11 or later is needed; name one with 'make PYTHON=python3.12 ...'" >&2; exit 1; }
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev]'
	@touch $@

tables: $(INSTALLED)
	-@$(BIN)/nrsfm data get
	-@$(BIN)/nrsfm run experiment=tables
	@$(BIN)/nrsfm report --quiet

test: $(INSTALLED)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/pytest

bench: $(INSTALLED)
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev,bench]'
	$(BIN)/pytest tests/benchmarks --override-ini addopts= --benchmark-columns=min,median,rounds

validate: $(INSTALLED)
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev,ray,server]'
	$(BIN)/pytest -m slow

test-server: $(INSTALLED)
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev,server]'
	@$(BIN)/python -c 'import sys; from tests.harness.tracking.servers import postgres_folder as p; sys.exit(p() is None)' || \
	  { [ "$$(id -u)" = 0 ] && apt-get update --quiet && apt-get install --quiet --yes postgresql; } || \
	  { echo "PostgreSQL's programs are not there: install them (Debian: apt-get install postgresql)" >&2; exit 1; }
	$(BIN)/pytest -m postgres

FUZZ_EXAMPLES ?= 1000
FUZZ_SECONDS ?= 60

fuzz: $(INSTALLED)
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev,fuzz]'
	FUZZ_EXAMPLES=$(FUZZ_EXAMPLES) $(BIN)/pytest tests/fuzz --numprocesses=0
	FUZZ_SECONDS=$(FUZZ_SECONDS) $(BIN)/python -m tests.fuzz.coverage

docs: $(INSTALLED)
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev,docs]'
	$(BIN)/python -m sphinx --quiet --fail-on-warning --keep-going --builder html --doctree-dir build/doctrees docs build/docs
	@echo "Open build/docs/index.html"

dist: $(INSTALLED)
	$(BIN)/python -m build --no-isolation

format: $(INSTALLED)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

clean:
	rm -rf .venv build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache
