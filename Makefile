# `make` prints the targets. Everything runs in .venv/, which `make venv` makes.

BIN := .venv/bin
STAMP := .venv/.installed
GL_PACKAGES := libegl1 libgl1
GL_CHECK := $(BIN)/python -c "import moderngl; moderngl.create_context(standalone=True, backend='egl')"

# True of a Python that is new enough and can make environments (Debian packs that apart).
VENV_READY := import sys, ensurepip, venv; assert sys.version_info >= (3, 11)

# Shell functions for the recipes below; `install_debian` says what to do where it may not.
define SHELL_TOOLS
as_root() { if [ "$$(id -u)" = 0 ]; then "$$@"; else sudo -n "$$@"; fi; }; \
may_install() { command -v apt-get >/dev/null 2>&1 && as_root true >/dev/null 2>&1; }; \
install_debian() { \
  if may_install; then \
    echo "== installing $$* (apt-get)"; \
    as_root apt-get update -qq && \
    as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$$@"; \
  else \
    echo "Missing: $$*. On Debian or Ubuntu run" >&2; \
    echo "    sudo apt-get update && sudo apt-get install -y --no-install-recommends $$*" >&2; \
    echo "and then make again." >&2; \
    return 1; \
  fi; }; \
find_python() { \
  for name in python3 /usr/bin/python3 python3.14 python3.13 python3.12 python3.11; do \
    if "$$name" -c "$$1" >/dev/null 2>&1; then echo "$$name"; return 0; fi; \
  done; \
  return 1; }
endef

.PHONY: help venv gl demo test lint clean

help:
	@echo "make demo   ingest the sample world, fly it, write demo/index.html"
	@echo "make test   everything the project checks"
	@echo "make lint   ruff, mypy and import-linter only"
	@echo "make venv   the environment in .venv/"
	@echo "make gl     check that a picture can be made without a screen"
	@echo "make clean  remove caches, builds and demo/ (keeps .venv/)"

venv: $(STAMP)

$(STAMP): pyproject.toml
	@$(SHELL_TOOLS); \
	set -e; \
	if ! $(BIN)/python -m pip --version >/dev/null 2>&1; then \
	  python=$$(find_python "$(VENV_READY)") || { \
	    install_debian python3 python3-venv; \
	    python=$$(find_python "$(VENV_READY)") || { \
	      echo "No Python 3.11 or newer with venv was found: install one, then make again." >&2; \
	      exit 1; }; \
	  }; \
	  echo "== making .venv with $$("$$python" --version)"; \
	  "$$python" -m venv --clear .venv; \
	fi; \
	echo "== installing geopage and its libraries into .venv (a few minutes the first time)"; \
	PIP_DISABLE_PIP_VERSION_CHECK=1 $(BIN)/python -m pip install -qq -e '.[report,video,gui,dev]'; \
	touch $@

gl: venv
	@$(SHELL_TOOLS); \
	if ! $(GL_CHECK) >/dev/null 2>&1; then \
	  install_debian $(GL_PACKAGES) || exit 1; \
	  $(GL_CHECK) || { echo "OpenGL without a screen does not work here (see above)." >&2; exit 1; }; \
	fi

demo: venv gl
	@$(BIN)/geopage demo --out demo

lint: venv
	@echo "== ruff check"
	@$(BIN)/ruff check .
	@echo "== ruff format"
	@$(BIN)/ruff format --check .
	@echo "== mypy"
	@$(BIN)/mypy
	@echo "== import-linter"
	@$(BIN)/lint-imports --no-logo

test: venv gl lint
	@echo "== pytest"
	@$(BIN)/python -m pytest

clean:
	rm -rf demo build dist *.egg-info .benchmarks .hypothesis .import_linter_cache \
	  .mypy_cache .pytest_cache .ruff_cache
	find . -path ./.venv -prune -o -type d -name __pycache__ -prune -exec rm -rf {} +
