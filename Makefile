# make tables   the paper's tables 1 and 2, on the real sequences where they are found or can be downloaded
# make test     the test suite
PYTHON ?= python3
BIN := .venv/bin
INSTALLED := .venv/.installed

.PHONY: tables test lint types check validate bench clean help

help:
	@grep -E '^# make' Makefile | cut -c3-

$(INSTALLED): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "Python 3.11 or later is needed; name one with 'make PYTHON=python3.12 ...'" >&2; exit 1; }
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev]'
	@touch $@

test: $(INSTALLED)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/pytest

lint: $(INSTALLED)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

bench: $(INSTALLED)
	$(BIN)/pytest tests/benchmarks --ignore= -o addopts= --benchmark-group-by=group

clean:
	rm -rf .venv outputs build dist *.egg-info
