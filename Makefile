# Two commands do all the set-up on a fresh machine: `make demo` and `make test`.

PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed

# Byte code is kept: every command that a test or a page starts would compile the package again.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: demo test types suite slow docs docs-serve browser reports controllers measured dist clean

demo: $(STAMP)
	$(BIN)/sysid demo -o out/demo

# Types are checked, and then the documentation is built, beside the tests: each works on one core.
test: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(MAKE) --no-print-directory -j 2 types suite docs

types: $(STAMP)
	$(BIN)/mypy
	$(BIN)/mypy --explicit-package-bases benchmarks datasets reports tools

suite: $(STAMP) browser
	MAKEFLAGS= OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/pytest -n 2 --dist worksteal

# Long searches and real recordings, which `make test` leaves out where a quicker test has the same.
slow: $(STAMP)
	MAKEFLAGS= OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/pytest -n 2 -m slow

# The pages run what they show; a warning, or a command that fails, fails the build.
docs: $(STAMP)
	$(BIN)/sphinx-build -W --keep-going -q -d out/docs-trees docs out/docs

docs-serve: docs
	$(BIN)/python -m http.server --directory out/docs 8000

# The report is tested in Debian's Chromium; where it cannot be installed those tests are skipped.
browser:
	@command -v chromium >/dev/null || { [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null \
		&& apt-get update -qq && apt-get install -y -qq chromium >/dev/null; } \
		|| echo "chromium is not installed: the browser tests of the report will be skipped"

# The example report, regenerated from the bundled campaign.
reports: $(STAMP)
	$(BIN)/python reports/make.py

# The thesis' tables and figures of controllers, computed anew: reports/controllers.html.
controllers: $(STAMP)
	$(BIN)/python reports/make_controllers.py

# Every measured set next to the project: its report, and the table in README.md.
measured: $(STAMP)
	$(BIN)/python -m datasets.measured --readme README.md

# The release check: wheel and sdist, and `sysid demo` from the wheel in an empty environment.
dist: $(STAMP)
	$(BIN)/pip install -q -c constraints.txt -e ".[release]"
	$(BIN)/python tools/release_check.py

$(STAMP): pyproject.toml constraints.txt
	test -d $(VENV) || $(PYTHON) -m venv $(VENV)
	$(BIN)/pip install -q -c constraints.txt -e ".[test]"
	touch $@

clean:
	rm -rf $(VENV) out dist .mypy_cache .ruff_cache .pytest_cache
