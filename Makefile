# Everything starts here: `make demo`, `make test`. Needs python3 (3.11 or newer, with venv), make and git.
.DEFAULT_GOAL := help
SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
VENV := .venv
BIN := $(VENV)/bin
PYTEST_ARGS ?=
IMAGES ?=
# compiling every module anew, and every test's assertions, would cost each process of the tests twenty seconds
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help demo test test-fast study lint format types imports migrations hooks containers pages supply serve mutants clean tools

help: ## show what there is
	@grep -E '^[a-z-]+:.*## ' Makefile | sed -E 's/:.*## /\t/' | expand -t 14

tools:
	@missing=""; \
	command -v git >/dev/null || missing="$$missing\n  git: install the package git"; \
	if ! command -v python3 >/dev/null; then missing="$$missing\n  python3: install Python 3.11 or newer"; \
	elif ! python3 -c 'import sys; sys.exit(sys.version_info < (3, 11))'; then \
	  missing="$$missing\n  python3 is $$(python3 -V 2>&1), 3.11 or newer is needed"; \
	elif ! python3 -c 'import venv, ensurepip' 2>/dev/null; then \
	  missing="$$missing\n  venv: install the package python3-venv"; fi; \
	if [ -n "$$missing" ]; then printf "missing tools:$$missing\n" >&2; exit 1; fi

# one stamp per set of dependencies; an interrupted install is done again
$(VENV)/.installed: pyproject.toml | tools
	@echo "making the virtual environment (some minutes the first time) ..."
	@python3 -m venv "$(VENV)"
	@"$(BIN)/python" -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@touch "$@"

demo: $(VENV)/.installed ## simulate a small fleet, upload it, show verdicts, keep serving
	@"$(BIN)/casedrain" demo $(DEMO_ARGS)

test: $(VENV)/.installed ## run every test but studies and the containerised one
	@"$(BIN)/python" -m detectors.warm_up
	@"$(BIN)/python" -m pytest -n 3 --dist worksteal -m "not containers and not study and not pages" $(PYTEST_ARGS)

test-fast: $(VENV)/.installed ## run a selection that enters every room, on SQLite, in a minute
	@"$(BIN)/python" -m detectors.warm_up
	@"$(BIN)/python" -m pytest -n 3 --dist worksteal -m fast -k "not postgres" $(PYTEST_ARGS)

study: $(VENV)/.installed ## run the longer numerical and statistical studies
	@"$(BIN)/python" -m detectors.warm_up
	@"$(BIN)/python" -m pytest -n 2 --dist worksteal -m study $(PYTEST_ARGS)

lint: $(VENV)/.installed ## style and common mistakes
	@"$(BIN)/ruff" check .
	@"$(BIN)/ruff" format --check .

format: $(VENV)/.installed ## put the code into shape
	@"$(BIN)/ruff" check --fix .
	@"$(BIN)/ruff" format .

types: $(VENV)/.installed ## mypy, strict
	@"$(BIN)/mypy"

imports: $(VENV)/.installed ## the direction of imports
	@"$(BIN)/lint-imports"

migrations: $(VENV)/.installed ## tables and migrations agree, on SQLite and on Postgres
	@"$(BIN)/python" tests/check_migrations.py

hooks: $(VENV)/.installed ## check what CI checks before every commit (installs pre-commit hooks)
	@"$(BIN)/pre-commit" install

containers: $(VENV)/.installed ## build and run the image and the compose file on a real engine (root, Debian)
	@"$(BIN)/python" -m pytest -p no:xdist -m containers tests/containers $(PYTEST_ARGS)

$(VENV)/.pages: pyproject.toml $(VENV)/.installed
	@"$(BIN)/python" -m pip install --quiet --disable-pip-version-check --editable '.[pages]'
	@touch "$@"

pages: $(VENV)/.pages ## look at every page in Chromium: tasks, accessibility, widths (IMAGES=folder keeps pictures)
	@command -v chromium chromium-browser google-chrome >/dev/null || { echo "make pages needs Chromium: install the package chromium" >&2; exit 1; }
	@"$(BIN)/python" -m detectors.warm_up
	@CASEDRAIN_IMAGES="$(IMAGES)" "$(BIN)/python" -m pytest -p no:xdist -m pages tests/pages $(PYTEST_ARGS)

# in an environment of their own: what lists the packages is none of them
.venv-supply/.installed: pyproject.toml | tools
	@python3 -m venv .venv-supply
	@.venv-supply/bin/python -m pip install --quiet --disable-pip-version-check \
	  $$(python3 -c "import tomllib; print(*tomllib.load(open('pyproject.toml', 'rb'))['project']['optional-dependencies']['supply'])")
	@touch "$@"

supply: $(VENV)/.installed .venv-supply/.installed ## bill of materials (build/sbom.json) and audit of the dependencies; 3: nobody could be asked
	@.venv-supply/bin/python tests/supply_chain.py sbom build/sbom.json "$(BIN)/python"
	@.venv-supply/bin/python tests/supply_chain.py audit "$$("$(BIN)/python" -c 'import sysconfig; print(sysconfig.get_path("purelib"))')"

mutants: $(VENV)/.installed ## change a line at a time and see whether tests notice (half an hour)
	@"$(BIN)/python" -m benchmarks.mutants $(MUTANTS_ARGS)

serve: $(VENV)/.installed ## serve API and pages on this machine
	@"$(BIN)/casedrain" serve

clean: ## remove the virtual environment and what tools left behind
	rm -rf "$(VENV)" .venv-supply .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis build dist
