# Everything happens in .venv, which the first target that needs it makes; `make` alone lists the targets.
.DEFAULT_GOAL := help
.PHONY: help run test lint format bench lock clean

# The interpreter to make .venv with (empty: the newest that suits), options of `pfviz serve`, options of pytest.
PYTHON ?=
ARGS ?=
PYTEST_ARGS ?= -n auto --maxprocesses=4 --dist=loadfile

BIN := .venv/$(if $(filter Windows_NT,$(OS)),Scripts,bin)
PY := $(BIN)/python
unexport PYTHONHOME PYTHONPATH
export PYTHON
export PYRIGHT_PYTHON_IGNORE_WARNINGS := 1

help: ## list the targets
	@sed -n 's/^\([a-z]*\):.*## \(.*\)/  make \1	\2/p' Makefile

run: ## start the app: make run ARGS="--port 9000"
	@sh scripts/environment.sh run
	@exec $(BIN)/pfviz serve $(ARGS)

test: lint ## lint, types and all tests, those in a browser too
	@exec $(PY) scripts/with_browser.py -m pytest $(PYTEST_ARGS)

lint: ## ruff and pyright
	@sh scripts/environment.sh dev
	@$(PY) -m ruff check .
	@$(PY) -m ruff format --check .
	@$(PY) -m pyright --pythonpath $(PY)

format: ## mend what ruff can mend
	@sh scripts/environment.sh dev
	@$(PY) -m ruff check --fix .
	@$(PY) -m ruff format .

bench: ## run benchmarks/
	@sh scripts/environment.sh run
	@for script in $(wildcard benchmarks/[!_]*.py); do echo "$$script"; $(PY) "$$script" || exit 1; done

lock: ## resolve requirements.lock anew, for every supported Python and system
	@sh scripts/environment.sh venv
	@$(PY) -m pip install --quiet uv
	@$(PY) -m uv pip compile pyproject.toml --extra dev --universal --python-version 3.11 --fork-strategy fewest \
		--upgrade --no-annotate --no-emit-index-url --no-emit-find-links \
		--custom-compile-command "make lock" --output-file requirements.lock --quiet

clean: ## remove .venv and everything generated
	rm -rf .venv build dist .pytest_cache .ruff_cache .hypothesis test-results
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
