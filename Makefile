# make demo    set up and run the whole pipeline on the shipped recording
# make test    set up and run the tests
# make quick   the tests that start no process and draw nothing
# make check   format, lint, types, import rules, conventions, spelling
# make docs    build the documentation as a site, out/site
# make fuzz    feed every decoder and file reader with hostile bytes, an hour
# make audit   compare all packages with known vulnerabilities
# make sbom    write the bill of materials (CycloneDX), out/sbom.cdx.json
# make lock    renew the pinned dependencies

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
unexport PYTHONDONTWRITEBYTECODE  # the tests start hundreds of processes

.PHONY: demo test quick check types rules docs format fuzz audit sbom lock clean
.DELETE_ON_ERROR:

demo: $(VENV)/.run
	$(BIN)/people4d demo --report out/demo || test $$? -eq 3  # 3: complete, on a slow machine

test: $(VENV)/.dev
	$(BIN)/pytest -n 3 --dist loadgroup  # for two cores: tests wait for processes a third of the time

quick: $(VENV)/.dev
	$(BIN)/pytest -n 2 -m "not processes and not network and not render and not slow"

docs: $(VENV)/.docs
	$(BIN)/mkdocs build -q
	@echo "Open out/site/index.html"

check: $(VENV)/.dev
	@$(MAKE) --no-print-directory --jobs 2 --output-sync types rules

types:
	$(BIN)/mypy

rules:
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/lint-imports --no-cache
	$(BIN)/codespell
	$(BIN)/python -m scripts.message_docs --check
	$(BIN)/python -m scripts.conventions
	$(BIN)/python -m scripts.table_age
	$(BIN)/python -m benchmarks readme --check

format: $(VENV)/.dev
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

fuzz: $(VENV)/.dev
	$(BIN)/pip install -q --disable-pip-version-check "atheris>=3"
	$(BIN)/python -m tests.fuzz --minutes 60

audit: $(VENV)/.audit
	$(BIN)/python -m scripts.audit

sbom: $(VENV)/.audit
	$(BIN)/python -m scripts.sbom out/sbom.cdx.json

$(VENV)/bin/pip:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "people4d needs Python 3.11 or newer; name one with: make PYTHON=python3.11 ..."; exit 1; }
	@$(PYTHON) -m venv $(VENV) || \
		{ rm -rf $(VENV); echo "No virtual environment; on Debian: apt install python3-venv"; exit 1; }

$(VENV)/.run: $(VENV)/bin/pip requirements.lock pyproject.toml people4d/pyproject.toml
	@echo "Setting up $(VENV) (once, about a minute) ..."
	$(BIN)/pip install -q --disable-pip-version-check --require-hashes -r requirements.lock
	$(BIN)/pip install -q --disable-pip-version-check --no-deps --no-build-isolation -e ./people4d -e .
	@touch $@

$(VENV)/.dev: $(VENV)/.run requirements-dev.lock
	@echo "Setting up the development tools ..."
	$(BIN)/pip install -q --disable-pip-version-check --require-hashes -r requirements-dev.lock
	@touch $@

$(VENV)/.docs: $(VENV)/.run requirements-docs.lock
	@echo "Setting up the tools of the documentation ..."
	$(BIN)/pip install -q --disable-pip-version-check --require-hashes -r requirements-docs.lock
	@touch $@

$(VENV)/.audit: $(VENV)/.run requirements-audit.lock
	@echo "Setting up the tools of the supply chain ..."
	$(BIN)/pip install -q --disable-pip-version-check --require-hashes -r requirements-audit.lock
	@touch $@

lock: $(VENV)/.run
	$(BIN)/pip install uv
	$(BIN)/uv pip compile pyproject.toml --extra dashboard --extra build --generate-hashes --universal --upgrade --python-version 3.11 \
		--no-header --no-annotate --no-emit-package people4d -o requirements.lock
	$(BIN)/uv pip compile pyproject.toml --extra dashboard --extra build --extra dev -c requirements.lock \
		--generate-hashes --universal --upgrade --python-version 3.11 --no-header --no-annotate --no-emit-package people4d -o requirements-dev.lock
	$(BIN)/uv pip compile pyproject.toml --extra docs -c requirements-dev.lock --generate-hashes --universal --upgrade \
		--python-version 3.11 --no-header --no-annotate --no-emit-package people4d -o requirements-docs.lock
	$(BIN)/uv pip compile pyproject.toml --extra audit -c requirements-dev.lock --generate-hashes --universal --upgrade \
		--python-version 3.11 --no-header --no-annotate --no-emit-package people4d -o requirements-audit.lock

clean:
	rm -rf $(VENV) out .mypy_cache .ruff_cache .pytest_cache .hypothesis *.egg-info
