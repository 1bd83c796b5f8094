# make demo    set up and run the whole pipeline on the shipped recording
# make test    set up and run the tests
# make check   format, lint, types, import rules, spelling
# make fuzz    feed every decoder and file reader with hostile bytes, half an hour
# make lock    renew the pinned dependencies

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin


.PHONY: demo test check format fuzz lock clean
.DELETE_ON_ERROR:

demo: $(VENV)/.run
	$(BIN)/people4d demo --report out/demo

test: $(VENV)/.dev
	$(BIN)/pytest

check: $(VENV)/.dev
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache
	$(BIN)/codespell
	$(BIN)/python -m scripts.message_docs --check

format: $(VENV)/.dev
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

fuzz: $(VENV)/.dev
	$(BIN)/pip install --disable-pip-version-check "atheris>=3"
	$(BIN)/python -m tests.fuzz --minutes 30

$(VENV)/bin/pip:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "people4d needs Python 3.11 or newer; name one with: make PYTHON=python3.11 ..."; exit 1; }
	@$(PYTHON) -m venv $(VENV) || \
		{ rm -rf $(VENV); echo "No virtual environment; on Debian: apt install python3-venv"; exit 1; }

$(VENV)/.run: $(VENV)/bin/pip requirements.lock pyproject.toml
	@echo "Setting up $(VENV) (once, about a minute) ..."
	$(BIN)/pip install --disable-pip-version-check --require-hashes -r requirements.lock
	$(BIN)/pip install --disable-pip-version-check --no-deps --no-build-isolation -e '.[robot]'
	@touch $@

$(VENV)/.dev: $(VENV)/.run requirements-dev.lock
	@echo "Setting up the development tools ..."
	$(BIN)/pip install --disable-pip-version-check --require-hashes -r requirements-dev.lock
	@touch $@

lock: $(VENV)/.run
	$(BIN)/pip install uv
	$(BIN)/uv pip compile pyproject.toml --extra robot --extra build --generate-hashes --universal --upgrade --python-version 3.11 \
		--no-header --no-annotate -o requirements.lock
	$(BIN)/uv pip compile pyproject.toml --extra robot --extra build --extra dev -c requirements.lock \
		--generate-hashes --universal --upgrade --python-version 3.11 --no-header --no-annotate -o requirements-dev.lock

clean:
	rm -rf $(VENV) out .mypy_cache .ruff_cache .pytest_cache .hypothesis *.egg-info
