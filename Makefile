# `make demo` and `make test` set up all they need; git, make and Python 3.11 or later are enough.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
CORE := $(VENV)/.core
READY := $(VENV)/.ready
RIVALS := $(VENV)/.rivals
PAGES := $(VENV)/.pages
SERVE ?= virtual:rx28@1-4,drs0602@219,lx16a@1,2
# LeRobot needs Python 3.12 or later, and what it imports for robots needs few of its dependencies.
COMPANION := companions/lerobot_robot_servobus
LEROBOT_VENV := .venv-lerobot
LEROBOT_READY := $(LEROBOT_VENV)/.ready
LATER := python3.14 python3.13 python3.12 $(sort $(wildcard $(HOME)/.pyenv/versions/3.1[2-4].*/bin/python3))
LEROBOT_PYTHON ?= $(firstword $(shell for python in $(PYTHON) $(LATER); do \
	$$python -c 'import sys; sys.exit(sys.version_info < (3, 12))' 2>/dev/null && echo $$python; done))
LEROBOT := lerobot==0.6.1 draccus==0.11.6 mergedeep typing-inspect typing_extensions mypy_extensions pyyaml \
	pyyaml-include toml huggingface_hub numpy tqdm packaging filelock fsspec httpx requests
# One process for each core, and a test goes to whoever is free. Tests start many programs: these find their bytecode.
SPREAD := -n auto --dist worksteal
# Short of all models many tests wait more than they reckon: one process more than cores keeps the cores at work.
BUSY := -n $(shell $(PYTHON) -c 'import os; print((os.cpu_count() or 1) + 1)') --dist worksteal
# Tests on real time may fail where the others keep all cores busy: what failed is run once more, by itself.
ALONE = echo "what failed, once more by itself" && $(BIN)/python -m pytest --all --last-failed --ignore=tests/browser
unexport PYTHONDONTWRITEBYTECODE
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check

.DEFAULT_GOAL := help
.PHONY: help setup demo serve test test-all test-browser test-lerobot check format docs bench faults soak clean

help:  ## show this list
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*##/\t/' | expand -t 12

$(CORE): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "servobus needs Python 3.11 or later; say which with: make PYTHON=python3.12 ..."; exit 1; }
	@echo "setting up $(VENV) (once)"
	@$(PYTHON) -m venv $(VENV)
	@$(PIP) --upgrade "pip>=25.1"
	@$(PIP) --editable .
	@touch $(CORE)

$(READY): $(CORE)
	@echo "adding what tests and checks need (once, about a minute)"
	@$(PIP) --group dev --group clients
	@touch $(READY)

$(RIVALS): $(READY)
	@echo "adding what only the bench compares with (once; pypot brings much along)"
	@$(PIP) --group bench || echo "the bench goes on without what could not be installed"
	@touch $(RIVALS)

setup: $(READY)  ## make the environment in .venv

demo: $(CORE)  ## find, read and move virtual servos of three families
	@$(BIN)/servobus demo

$(PAGES): $(CORE)
	@echo "adding what the pages need (once)"
	@$(PIP) --editable ".[web,mcap]"
	@touch $(PAGES)

serve: $(PAGES)  ## open the manager in a browser, on virtual servos; SERVE="/dev/ttyUSB0" for real ones
	@$(BIN)/servobus serve $(SERVE) --open

test: $(READY)  ## run the tests, slow ones with a few models that stand for all
	@echo "without the pages in a browser: make test-browser runs those"
	@$(BIN)/python -m pytest $(BUSY) --ignore=tests/browser

test-all: $(READY)  ## run all tests with all models, and more examples of each property
	@$(BIN)/python -m pytest $(SPREAD) --all --ignore=tests/browser || { [ $$? = 1 ] && $(ALONE); }

test-browser: $(READY)  ## run the tests of the pages, in a browser (chromium) where there is one
	@$(BIN)/python -m pytest tests/browser -rs

test-lerobot:  ## run the tests of the companion for LeRobot, where there is Python 3.12 or later
	@if [ -z "$(LEROBOT_PYTHON)" ]; then \
		echo "skipped: LeRobot needs Python 3.12 or later; make LEROBOT_PYTHON=python3.12 test-lerobot says which"; \
	else \
		$(MAKE) --no-print-directory $(LEROBOT_READY) && \
		cd $(COMPANION) && $(CURDIR)/$(LEROBOT_VENV)/bin/python -m pytest; \
	fi

$(LEROBOT_READY): pyproject.toml $(COMPANION)/pyproject.toml Makefile
	@echo "setting up $(LEROBOT_VENV) (once): LeRobot without what it needs for learning"
	@$(LEROBOT_PYTHON) -m venv $(LEROBOT_VENV)
	@$(LEROBOT_VENV)/bin/python -m pip install --quiet --disable-pip-version-check pytest --editable .
	@$(LEROBOT_VENV)/bin/python -m pip install --quiet --disable-pip-version-check --no-deps $(LEROBOT)
	@$(LEROBOT_VENV)/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --editable $(COMPANION)
	@touch $(LEROBOT_READY)

check: $(READY)  ## format, lint, types, imports, generated pages
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python docs/generate.py --check

format: $(READY)  ## put the code into shape
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

docs: $(READY)  ## write the reference pages from the tables
	$(BIN)/python docs/generate.py

bench: $(RIVALS)  ## microseconds and CPU of a read beside other drivers, in one run
	$(BIN)/python -m bench

faults: $(RIVALS)  ## wrong values and errors of all drivers under the same wire faults
	$(BIN)/python -m bench.faults

soak: $(READY)  ## a million reads and writes under wire faults, each compared with the truth; SOAK="--seconds 60" is less
	$(BIN)/python -m bench.soak $(SOAK)

clean:  ## remove what was built
	rm -rf $(VENV) $(LEROBOT_VENV) .mypy_cache .ruff_cache .pytest_cache .hypothesis build dist src/*.egg-info
