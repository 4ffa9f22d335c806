# Everything happens in .venv, which holds what requirements.lock names and this working copy, and nothing else.

CONFIG ?= planar-sim
PYTHON ?= python3
PREFIX ?= /opt/rtctl
DESTDIR ?=

BIN := .venv/bin
READY := .venv/.ready
UV := $(shell uv --version >/dev/null 2>&1 && command -v uv || echo build/uv/bin/uv)

export UV_PYTHON_DOWNLOADS := never
export UV_NO_PROGRESS := 1
# Without bytecode every start would compile a thousand files anew: 3 s for each of the daemon's processes.
unexport VIRTUAL_ENV PYTHONPATH PYTHONHOME PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help run test check bench golden warmup docs/reference lock install clean

help:  ## this list
	@awk -F ':.*## ' '/^[a-z\/]+:.*## / { printf "  make %-16s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

run: $(READY)  ## a whole insertion through the real-time daemon, on the simulated robot [CONFIG=planar-sim]
	@$(BIN)/rtctl demo $(CONFIG)

# Daemons are tested one after the other, with the machine to themselves; everything else on all cores.
APART := tests/daemon tests/packaging
test: $(READY)  ## all tests, or some [ARGS="tests/rtctl/log -k recover"]
	@$(BIN)/rtctl warmup $(CONFIG)
ifdef ARGS
	@$(BIN)/python -m pytest $(ARGS)
else
	@$(BIN)/python -m pytest -n auto --dist loadfile $(APART:%=--ignore=%)
	@$(BIN)/python -m pytest $(APART)
endif

check: $(READY)  ## style, types, import contracts, and whether the reference pages are up to date
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo
	$(BIN)/python -m rtctl.reference --check

bench: $(READY)  ## speed: tick against C++ (g++), wake-up against cyclictest (rt-tests), lockstep [ARGS=--help]
	@$(BIN)/python -m bench $(ARGS)

golden: $(READY)  ## golden logs anew, after a change of arithmetic that was meant: say why in the commit
	@$(BIN)/python tests/rtctl/golden/make_golden.py $(ARGS)

warmup: $(READY)  ## compile the kernels now instead of at the first start
	@$(BIN)/rtctl warmup $(CONFIG)

docs/reference: $(READY)  ## write docs/reference anew from the tables it documents
	@$(BIN)/python -m rtctl.reference

lock: | $(UV)  ## pin what pyproject.toml asks for, with hashes [ARGS=--upgrade]
	$(UV) pip compile --quiet $(ARGS) --universal --python-version 3.11 --generate-hashes \
		--no-annotate --no-header --no-emit-index-url --group dev pyproject.toml -o requirements.lock

install: | $(UV)  ## for a target PC: program, settings and systemd unit [PREFIX=/opt/rtctl] [DESTDIR=]
	$(UV) venv --quiet --allow-existing --relocatable --python $(PYTHON) $(DESTDIR)$(PREFIX)
	$(UV) pip install --quiet --python $(DESTDIR)$(PREFIX)/bin/python --compile-bytecode \
		--constraint requirements.lock --reinstall-package rtctl .
	install -d $(DESTDIR)$(PREFIX)/share/doc/rtctl $(DESTDIR)/etc/rtctl
	cp -r docs/. $(DESTDIR)$(PREFIX)/share/doc/rtctl
	for file in config/*.toml; do \
		test -e $(DESTDIR)/etc/rtctl/$${file#config/} || install -m 0644 $$file $(DESTDIR)/etc/rtctl; done
	install -D -m 0644 packaging/systemd/rtctl.sysusers $(DESTDIR)/etc/sysusers.d/rtctl.conf
	install -D -m 0644 packaging/systemd/90-rtctl.rules $(DESTDIR)/etc/udev/rules.d/90-rtctl.rules
	install -d $(DESTDIR)/etc/systemd/system
	sed 's#@PREFIX@#$(PREFIX)#' packaging/systemd/rtctl@.service > $(DESTDIR)/etc/systemd/system/rtctl@.service
	@echo "Next: systemd-sysusers; udevadm control --reload; udevadm trigger; systemctl daemon-reload;"
	@echo "      systemctl start rtctl@$(CONFIG)"

clean:  ## remove everything make has made; runs stay
	rm -rf .venv build dist .ruff_cache .mypy_cache .import_linter_cache .hypothesis .benchmarks
	find hal rtctl drivers sim_backends config tests -name __pycache__ -prune -exec rm -rf {} +

$(READY): requirements.lock pyproject.toml | $(BIN)/python
	@echo "Installing into .venv (a minute, once)"
	@$(UV) pip sync --quiet --compile-bytecode --python $(BIN)/python --require-hashes requirements.lock
	@$(UV) pip install --quiet --python $(BIN)/python --no-deps --no-build-isolation --editable .
	@touch $@

$(BIN)/python: | $(UV)
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 15))' \
		|| { echo "rtctl needs Python 3.11 to 3.14; name one: make PYTHON=python3.12"; exit 1; }
	@rm -rf .venv
	@$(UV) venv --quiet --python $(PYTHON) .venv

# Where there is no uv yet it is fetched for ourselves, by whatever a bare Debian has: pip, or a venv with pip inside.
build/uv/bin/uv:
	@echo "Fetching uv into build/uv"
	@rm -rf build/uv
	@if $(PYTHON) -I -m pip --version >/dev/null 2>&1; \
		then PIP_USER=0 PIP_ROOT_USER_ACTION=ignore $(PYTHON) -I -m pip install --quiet --disable-pip-version-check --target build/uv 'uv>=0.9'; \
		else $(PYTHON) -m venv build/uv && build/uv/bin/pip install --quiet --disable-pip-version-check 'uv>=0.9'; \
	fi || { rm -rf build/uv; echo "no pip and no venv: apt-get install python3-venv, then make again"; exit 1; }
