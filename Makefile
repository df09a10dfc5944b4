# Every target makes .venv when it is missing and installs into it; python3 (3.11 or newer) and make are all it needs.
PYTHON ?= python3
BIN := .venv/bin
FOLDERS := actuators walkers tasks gap
# A strict editable install links file by file, so a new file means a new install.
FILES := $(shell (find $(FOLDERS) -type f -not -name '*.pyc' | sort; cat setup.py pyproject.toml requirements.lock) | cksum | cut -d' ' -f1)
INSTALLED := .venv/installed-$(FILES)
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check

export MUJOCO_GL ?= disable

.PHONY: demo test test-fast lint bench docs package audit lock format install clean
.DEFAULT_GOAL := demo

demo: $(INSTALLED)
	$(BIN)/walkerkit demo $(ARGS)

test: lint
	$(BIN)/pytest --numprocesses 2 --dist loadfile --no-loadscope-reorder $(ARGS)

test-fast: $(INSTALLED)
	$(BIN)/pytest --fast --numprocesses 2 --dist loadfile --no-loadscope-reorder $(ARGS)

lint: $(INSTALLED)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: $(INSTALLED)
	$(BIN)/python -m benchmarks $(ARGS)

docs: export NO_MKDOCS_2_WARNING = 1
docs: $(INSTALLED)
	$(BIN)/mkdocs build --strict --quiet $(ARGS)
	@echo build/site/index.html

package: $(INSTALLED)
	.ci/package

audit: $(INSTALLED)
	.ci/audit

# The newest versions with ARGS=--upgrade.
lock: $(INSTALLED)
	.ci/lock $(ARGS)

format: $(INSTALLED)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

install: $(INSTALLED)

$(INSTALLED):
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	rm -rf build .venv/installed-*
	$(PIP) --no-deps --require-hashes --requirement requirements.lock
	$(PIP) --no-build-isolation --editable '.[dev]'
	touch $@

clean:
	rm -rf .venv build *.egg-info walkerkit-demo .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
