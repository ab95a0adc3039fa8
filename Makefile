# Every task by one name; `make` alone lists them. Each does its own set-up in .venv, and does it once.
# The dialect is that of GNU make 3.81, which macOS ships.

VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet

# PYTHON=... chooses the interpreter; otherwise the first of these that is 3.11 to 3.14 is taken.
PYTHONS := $(if $(PYTHON),"$(PYTHON)",python3 python3.14 python3.13 python3.12 python3.11)
SUPPORTED := import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 14))

# An environment that is missing, broken, or of another version than PYTHON=... is made anew.
version = $(shell "$(1)" -c 'import sys; print("%d.%d.%d" % sys.version_info[:3])' 2>/dev/null)
HAVE := $(call version,$(BIN)/python)
WANT := $(if $(PYTHON),$(call version,$(PYTHON)),$(HAVE))
STALE := $(if $(filter $(HAVE),$(WANT)),,stale)

.DEFAULT_GOAL := help
.NOTPARALLEL:
.PHONY: help demo test lint coverage bench notebooks docs clean stale

help: ## list the tasks
	@awk -F ':.*## ' '/^[a-z]+:.*## / { printf "make %-10s %s\n", $$1, $$2 }' Makefile
	@echo "PYTHON=python3.12 chooses the interpreter, ARGS='...' adds arguments to the command of a task."

demo: $(VENV)/.run ## localize a simulated vehicle in a simulated building; needs no data
	$(BIN)/factorloc demo $(ARGS)

test: $(VENV)/.dev ## run all tests; FACTORLOC_DATA=... names the folder of real logs
	MPLBACKEND=Agg $(BIN)/python -m pytest $(ARGS)

lint: $(VENV)/.dev ## check style, types and who imports whom
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

coverage: $(VENV)/.dev ## run all tests on interpreted kernels and report the lines they miss
	MPLBACKEND=Agg NUMBA_DISABLE_JIT=1 $(BIN)/coverage run -m pytest $(ARGS)
	$(BIN)/coverage report

bench: $(VENV)/.bench ## run the quick benchmarks
	MPLBACKEND=Agg $(BIN)/python -m benchmarks $(ARGS)

notebooks: $(VENV)/.dev ## execute the notebooks into results/notebooks
	@mkdir -p results/notebooks
	@for source in notebooks/*.py; do \
	    echo "executing $$source"; \
	    target=results/notebooks/$$(basename "$$source" .py).ipynb; \
	    $(BIN)/jupytext --quiet --set-kernel python3 --to ipynb --execute --output "$$target" "$$source" || exit 1; \
	done

docs: $(VENV)/.docs ## build the documentation into site
	$(BIN)/mkdocs build --strict

clean: ## remove the environment and everything built; results stay
	rm -rf $(VENV) build dist site htmlcov .coverage .coverage.* coverage.xml
	rm -rf .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache
	find factorloc tests benchmarks notebooks -name __pycache__ -type d -prune -exec rm -rf {} +

# ---- set-up: one stamp for each set of packages ----

$(VENV)/.made: $(STALE)
	@found=; venvless=; \
	for python in $(PYTHONS); do \
	    found="$$found $$("$$python" -c 'import sys; print("%s (%d.%d)" % ((sys.argv[1],) + sys.version_info[:2]))' \
	        "$$python" 2>/dev/null)"; \
	    "$$python" -c '$(SUPPORTED)' 2>/dev/null || continue; \
	    "$$python" -c 'import ensurepip, venv' 2>/dev/null || { venvless="$$python"; continue; }; \
	    echo "making $(VENV) with $$python"; \
	    "$$python" -m venv --clear $(VENV) && touch $@ && exit 0; \
	    exit 1; \
	done; \
	if [ -n "$$venvless" ]; then \
	    case "$$venvless" in *python3.[0-9]*) package=$$(basename "$$venvless")-venv;; *) package=python3-venv;; esac; \
	    echo "$$venvless cannot make environments: apt install $$package" >&2; \
	else \
	    found=$$(echo $$found); \
	    echo "factorloc needs Python 3.11 to 3.14; found $${found:-none}: install one, or name it with PYTHON=..." >&2; \
	fi; \
	exit 1

$(VENV)/.run: pyproject.toml $(VENV)/.made
	@echo "installing factorloc into $(VENV)"
	@$(PIP) install --editable .
	@touch $@

$(VENV)/.dev: pyproject.toml $(VENV)/.made
	@echo "installing factorloc and its development tools into $(VENV)"
	@$(PIP) install --editable '.[dev]'
	@{ $(PIP) install --editable '.[open3d]' && $(BIN)/python -c 'import open3d'; } >/dev/null 2>&1 \
	    || echo "open3d cannot be installed or loaded here: the tests that need it will be skipped"
	@touch $@ $(VENV)/.run

$(VENV)/.bench: pyproject.toml $(VENV)/.made
	@echo "installing factorloc and what its benchmarks need into $(VENV)"
	@$(PIP) install --editable '.[bench]'
	@touch $@ $(VENV)/.run

$(VENV)/.docs: pyproject.toml $(VENV)/.made
	@echo "installing factorloc and mkdocs into $(VENV)"
	@$(PIP) install --editable '.[docs]'
	@touch $@ $(VENV)/.run
