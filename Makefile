# make tables   the tables 1 and 2 of the paper, on the real sequences where found or downloadable, and two dancers without them
# make install  the environment .venv with all that tests and documents need
# make test     lint, types, import contracts and the test suite
# make bench    speed of the solvers beside named alternatives
# make validate the longer checks: published numbers on whole datasets, launchers, LaTeX; installs all that they need
# make validate-tracking  of these, what a change to tracking, launching or isolation needs: servers, launchers, kills
# make coverage the test suite with the branches that it covers, printed by module and as HTML in build/coverage
# make test-server  tracking on PostgreSQL, which is installed first where apt-get can do it
# make test-site  the documentation is built without a warning, and its links lead somewhere
# make docs     the documentation as a site, in build/docs
# make picture the moving picture of the README, in docs/dancers.gif
# make trust    the table of docs/trust.md, on the real sequences; about half an hour
# make dist     the wheel and the source distribution, in dist/
# make fuzz     damaged and hostile files for every reader: FUZZ_EXAMPLES made, then FUZZ_SECONDS of each by coverage
# make hooks    run lint, types and import contracts at every commit, by pre-commit
# make format   what lint and formatting can mend by themselves
# make clean    remove the environment and everything built; outputs and data stay
PYTHON ?= python3
BIN := .venv/bin
INSTALLED := .venv/.installed
PIP := $(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt

# $(call apt,PACKAGES): install Debian packages where this machine lets us, and go on where it does not
apt = { command -v apt-get >/dev/null && [ "$$(id -u)" = 0 ] && apt-get update --quiet=2 && \
  DEBIAN_FRONTEND=noninteractive apt-get install --quiet=2 --yes --no-install-recommends $(1) >/dev/null; } || \
  echo "cannot install $(1): what needs it is skipped" >&2
TEX := texlive-latex-base texlive-latex-recommended texlive-latex-extra

.PHONY: help install tables test check lint types contracts coverage test-server test-site validate validate-tracking browser tex postgres shells \
  bench fuzz picture trust docs dist hooks format clean

help:
	@grep -E '^# make' Makefile | cut -c3-

$(INSTALLED): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "Python 3.11 or later is needed; name one with 'make PYTHON=python3.12 ...'" >&2; exit 1; }
	@echo "Installing into .venv, which takes a minute or two"
	$(PYTHON) -m venv .venv
	$(PIP) --editable '.[dev,docs]'
	@touch $@

install: $(INSTALLED)
	@echo "Activate it with '. .venv/bin/activate'"

tables: $(INSTALLED)
	-@$(BIN)/nrsfm data get
	-@$(BIN)/nrsfm run experiment=tables missing=error
	-@$(BIN)/nrsfm run experiment=dancers
	@$(BIN)/nrsfm report table1 table2 dancers --quiet missing=error

test: check
	$(BIN)/pytest

check: lint types contracts

lint: $(INSTALLED)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(INSTALLED)
	$(BIN)/mypy

contracts: $(INSTALLED)
	$(BIN)/lint-imports

coverage: $(INSTALLED)
	$(BIN)/pytest --cov --cov-report=term --cov-report=html:build/coverage

bench: $(INSTALLED)
	$(PIP) --editable '.[dev,bench]'
	$(BIN)/pytest tests/benchmarks --override-ini addopts= --benchmark-columns=min,median,rounds

validate: $(INSTALLED) browser tex postgres shells
	$(PIP) --editable '.[dev,docs,ray,server,umpm,mat73]'
	$(BIN)/pytest -m 'slow or tex or site'

# By folder: every test, slow or not, of what starts, follows, kills and records trials.
TRACKING := tests/harness/sweep tests/harness/tracking tests/harness/trial
validate-tracking: $(INSTALLED) postgres
	$(PIP) --editable '.[dev,ray,server]'
	$(BIN)/pytest -m '' $(TRACKING)

test-server: $(INSTALLED) postgres
	$(PIP) --editable '.[dev,server]'
	@$(BIN)/python -c 'import sys; from tests.harness.tracking.servers import postgres_folder as p; sys.exit(p() is None)' || \
	  { echo "PostgreSQL's programs are missing: install them (Debian: apt-get install postgresql)" >&2; exit 1; }
	$(BIN)/pytest -m postgres

test-site: $(INSTALLED)
	$(BIN)/pytest -n0 -m site tests/documents

browser:
	@command -v chromium >/dev/null || command -v chromium-browser >/dev/null || command -v google-chrome >/dev/null || \
	  $(call apt,chromium)

tex:
	@{ command -v pdflatex && kpsewhich multirow.sty; } >/dev/null 2>&1 || $(call apt,$(TEX))

shells:
	@{ command -v zsh && command -v fish; } >/dev/null || $(call apt,zsh fish)

postgres: $(INSTALLED)
	@$(BIN)/python -c 'import sys; from tests.harness.tracking.servers import postgres_folder as p; sys.exit(p() is None)' || \
	  $(call apt,postgresql)

FUZZ_EXAMPLES ?= 1000
FUZZ_SECONDS ?= 60

fuzz: $(INSTALLED)
	$(PIP) --editable '.[dev,fuzz]'
	FUZZ_EXAMPLES=$(FUZZ_EXAMPLES) $(BIN)/pytest tests/fuzz --numprocesses=0
	FUZZ_SECONDS=$(FUZZ_SECONDS) $(BIN)/python -m tests.fuzz.coverage

picture: $(INSTALLED)
	$(BIN)/python -m tests.documents.picture docs/dancers.gif

trust: $(INSTALLED)
	$(BIN)/python -m tests.documents.trust docs/trust.md

docs: $(INSTALLED)
	$(BIN)/python -m sphinx --quiet --fail-on-warning --keep-going --builder html --doctree-dir build/doctrees docs build/docs
	@echo "Open build/docs/index.html"

dist: $(INSTALLED)
	$(BIN)/python -m build --no-isolation

hooks: $(INSTALLED)
	$(BIN)/pre-commit install

format: $(INSTALLED)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

clean:
	rm -rf .venv build dist src/*.egg-info .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .coverage .coverage.*
