# `make help` lists the targets. Everything runs in .venv, which is made on first use from environment.txt.

PYTHON ?= python3
ARGS ?=
BIN := .venv/bin

# Recordings of real cameras: where TRINOLAB_DATA says, else in a folder shared/data beside the checkout.
ifeq ($(TRINOLAB_DATA),)
ifneq ($(realpath ../shared/data),)
export TRINOLAB_DATA := $(realpath ../shared/data)
endif
endif
# Tests start hundreds of processes: without stored bytecode each would compile the package anew.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help book test core lab lint student teacher slides verify sweeps sheet bench figures pdf article dist browser clean

help:  ## show this list
	@sed -n 's/^\([a-z]*\):.*## /\1\t/p' $(MAKEFILE_LIST)

book: .venv/package.done  ## run the chapters, build the pages, print the scoreboard
	@$(BIN)/python book/build.py

# One process more than there are cores: some tests wait for others, or for a browser.
test: .venv/package.done  ## run the tests, quicker after make book; ARGS="-k pose" chooses some
	@$(BIN)/python -m pytest -n $$($(BIN)/python -c 'import os; print(os.cpu_count() + 1)') --dist worksteal $(ARGS)

core: .venv-core/package.done  ## the algorithms and their tests alone, in half a minute; needs no other target
	@.venv-core/bin/python -m pytest tests/trinolab -q -n 2 --dist loadfile -m "not heavy and not slow" --durations=0 \
	    --durations-min=1 $(ARGS)

lab: .venv/package.done  ## open the chapters in JupyterLab
	@$(BIN)/jupyter-lab --ServerApp.root_dir=. --LabApp.default_url=/lab/tree/notebooks \
	    --LabApp.extra_labextensions_path="$(CURDIR)/book/lab" $(if $(filter 0,$(shell id -u)),--allow-root)

lint: .venv/package.done  ## check style, types, imports and prose, and print the size of code and prose
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy
	@$(BIN)/lint-imports --no-logo
	@$(BIN)/python tests/helpers/prose.py
	@$(BIN)/python tests/helpers/size.py

student: book  ## the course for students, pages, notebooks and package without solutions: _build/student.zip
	@$(BIN)/python -m workbench.pages.coursezip student

teacher: book  ## the same with its solutions, the notes and the exam: _build/teacher.zip
	@$(BIN)/python -m workbench.pages.coursezip teacher

slides: book  ## slides for the lectures, from the chapters' own figures, in _build/slides
	@$(BIN)/python -m workbench.pages.slides

verify: .venv/package.done  ## the heavy counts, as a report: an hour, with pages in a browser after make browser; ARGS="--only nees --draws 100" is quick
	@$(BIN)/python tests/verify.py $(ARGS)

sweeps: .venv/package.done  ## make the tables in data/sweeps and data/sensitivity.csv again, but the two that need another renderer: two and a half hours
	@$(BIN)/python -m workbench.studies factors
	@$(BIN)/python -m workbench.studies budget
	@$(BIN)/python -m workbench.studies elevation
	@$(BIN)/python -m workbench.studies calibration_error
	@$(BIN)/python -m workbench.studies fitts
	@$(BIN)/python -m workbench.studies match_rivals
	@$(BIN)/python -m workbench.studies stress
	@$(BIN)/python -m workbench.studies webcams
	@$(BIN)/python -m workbench.studies bound
	@$(BIN)/python -m workbench.studies gallery
	@$(BIN)/python -m workbench.studies sensitivity
	@$(BIN)/python -m workbench.studies instant_times

sheet: .venv/package.done  ## the data sheet of the standard rig in _build/sheet, its numbers and its row of the control chart in data/accept: 15 minutes
	@$(BIN)/trinolab accept --rig raised_40deg --handle coded --chart data/accept/history.csv --out _build/sheet
	@cp _build/sheet/sheet.json data/accept/raised_40deg.json

bench: .venv/package.done  ## the time that a measurement, an instant of a track, a sweep, a tick of the arm, a live frame and a calibration take
	@$(BIN)/python tests/benchmarks/bench_measure.py
	@$(BIN)/python tests/benchmarks/bench_track.py
	@$(BIN)/python tests/benchmarks/bench_sweep.py
	@$(BIN)/python tests/benchmarks/bench_slave.py
	@$(BIN)/python tests/benchmarks/bench_live.py
	@$(BIN)/python tests/benchmarks/bench_calibrate.py

figures: .venv/package.done  ## all figures and films of the built pages as files, with a list, in _build/figures
	@$(BIN)/python -m workbench.pages.figures

pdf: .venv/package.done  ## the built pages as _build/trinolab.pdf, each printed page looked at: some minutes
	@$(BIN)/python -m workbench.pages.printing

article: .venv/package.done  ## the built page of the article as _build/article.pdf, each printed page looked at
	@$(BIN)/python -m workbench.pages.printing book/article --out _build/article.pdf

dist: .venv/package.done  ## the built pages as a zip for readers, and a wheel, in _build/dist
	@$(BIN)/python -m workbench.pages.dist

browser: book  ## the pages with cells that run in the reader's browser, in _build/browser; fetches the runtime once
	@$(BIN)/python -m workbench.browser.site

clean:  ## remove what was built, but not .venv
	rm -rf _build .pytest_cache .mypy_cache .ruff_cache .hypothesis

# What pip says is a line or two for each of 200 packages: of these the large ones, and how far it is.
SHORT := { n=0; while read -r word what; do case "$$word $$what" in \
	    Collecting*|Processing*) n=$$((n + 1)); [ $$((n % 25)) -ne 0 ] || echo "$$n packages are here";; \
	    Downloading*\([1-9][0-9]*MB\)*) echo "fetching $${what\#\#*/}";; \
	    Installing\ collected*) echo "installing $$n packages: a minute or two";; \
	    FAILED*) exit 1;; \
	esac; done; }

# The two stamps are written last: an install that was interrupted is done again from the start.
# Where uv fails (it brings certificates of its own, which not every network accepts), pip is tried.
.venv/environment.done: environment.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	    { echo 'trinolab needs Python 3.11 or later as $(PYTHON); name another one: make PYTHON=python3.12 ...' >&2; exit 1; }
	@echo 'making .venv from environment.txt: 200 packages, 2 GB, some minutes if they must be fetched'
	@rm -rf .venv
	@{ uv --version >/dev/null 2>&1 && set -x && \
	    uv venv --quiet --python "$$($(PYTHON) -c 'import sys; print(sys.executable)')" .venv && \
	    uv pip install --python $(BIN)/python --require-hashes -r environment.txt; } || \
	{ { set -x; rm -rf .venv; $(PYTHON) -m venv .venv && PYTHONUNBUFFERED=1 $(BIN)/python -m pip install \
	    --disable-pip-version-check --progress-bar off --require-hashes -r environment.txt || \
	    echo FAILED; } | $(SHORT); } || \
	{ echo 'FAILED: the environment; what pip said is above. When that is mended, type the same again.' >&2; exit 1; }
	@touch $@

# Only what the algorithms and their tests need; a tenth of the other environment.
.venv-core/package.done: pyproject.toml
	@rm -rf .venv-core
	$(PYTHON) -m venv .venv-core
	.venv-core/bin/python -m pip install --disable-pip-version-check --quiet -e '.[test-core]'
	@touch $@

.venv/package.done: .venv/environment.done pyproject.toml
	@if $(BIN)/python -m pip --version >/dev/null 2>&1; then \
	    set -x; $(BIN)/python -m pip install --disable-pip-version-check --quiet --no-deps --no-build-isolation -e .; \
	else \
	    set -x; uv pip install --quiet --python $(BIN)/python --no-deps --no-build-isolation -e .; \
	fi
	@$(BIN)/python -c 'from trinolab.estimators import pixels; pixels.prepare()'  # compiles the loops once
	@touch $@
