# Everything happens in .venv, which is made where it is missing. Only cargo, Python and make are needed.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
GYMNASIUM_VERSIONS := 1.1.1 1.2.2 1.4.0

SOURCES := Cargo.toml Cargo.lock pyproject.toml $(wildcard .cargo/*) \
	$(shell find crates -name '*.rs' -o -name Cargo.toml) \
	$(shell find python -type f -not -name '*.so' -not -name '*.pyc')
PIP := $(VENV)/pip.stamp
PACKAGE := $(VENV)/package.stamp
DEVELOPMENT := $(VENV)/development.stamp
GYMNASIUMS := $(GYMNASIUM_VERSIONS:%=$(VENV)/gymnasium-%)

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help demo test test-rust test-python test-gymnasium lint bench

help: ## Show what there is to make
	@awk -F ':.*## ' '/^[a-z]+:.*## / { printf "make %-6s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

demo: $(PACKAGE) ## Machine an example drawing under the camera of a simulated machine; leaves a report in demo/
	$(BIN)/lasergym demo tests/assets/thumbs_up.svg --output demo

test: test-rust test-python test-gymnasium ## Run every test, of Rust and of Python

test-rust:
	cargo test --quiet --workspace

test-python: $(DEVELOPMENT)
	$(BIN)/python -m pytest

test-gymnasium: $(DEVELOPMENT) $(GYMNASIUMS)
	set -e; for path in $(GYMNASIUMS); do \
		echo "$$path"; \
		PYTHONPATH=$$path $(BIN)/python -m pytest tests/python/test_env_checker.py; \
	done

lint: $(DEVELOPMENT) ## Check format, lints, types, stubs and documentation
	cargo fmt --check
	cargo clippy --quiet --workspace --all-targets -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc --quiet --workspace --no-deps
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/python -m mypy.stubtest lasergym._native

bench: $(DEVELOPMENT) ## Measure steps per second beside NumPy and SyncVectorEnv
	$(BIN)/lasergym bench --numpy-oracle tests/python/numpy_ablation.py

$(PIP):
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade 'pip>=25.1'
	touch $@

$(PACKAGE): $(SOURCES) | $(PIP)
	$(BIN)/python -m pip install --quiet .
	touch $@

$(DEVELOPMENT): $(SOURCES) | $(PIP)
	$(BIN)/python -m pip install --quiet '.[human,plots,ray,train]' --group test --group lint
	touch $(PACKAGE) $@

$(VENV)/gymnasium-%: | $(PIP)
	$(BIN)/python -m pip install --quiet --no-deps --target $@.part gymnasium==$*
	mv $@.part $@
