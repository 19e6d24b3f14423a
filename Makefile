# Every target is also a plain command in CONTRIBUTING.md.
# PYTHON is looked for where it is not given: bpy needs 3.11 up to 5.0 and 3.13 from 5.1 on.
PYTHON ?=
VENV ?= .venv
BPY ?= 4.5.15
# Tests run in this many processes, each with a Blender of its own.
WORKERS ?= auto
RUN = $(VENV)/bin/python
PYTEST = $(RUN) -m pytest -n $(WORKERS) --dist worksteal

.PHONY: venv demo test test-core test-blender test-window extension wheel lint random-edits bench bake-folder figures samples clean

venv: $(VENV)/installed-$(BPY)

$(VENV)/installed-$(BPY): pyproject.toml tools/make_venv.sh
	PYTHON="$(PYTHON)" VENV="$(VENV)" BPY="$(BPY)" sh tools/make_venv.sh

demo: venv
	$(RUN) tools/demo.py

test: venv
	$(PYTEST)

test-core: venv
	$(PYTEST) tests/core

test-blender: venv
	$(PYTEST) tests/blender tests/ui tests/command_line tests/extension

# Needs root: makes a Debian in a folder with a real Blender in it. DEBIAN=sid for the newest Blender.
test-window: venv
	$(RUN) -m pytest tests/window

extension: venv
	$(RUN) tools/build_extension.py

wheel: venv
	$(RUN) -m pip wheel --quiet --disable-pip-version-check --no-deps --wheel-dir build/wheel .

lint: venv
	$(RUN) -m ruff check .
	$(RUN) -m ruff format --check .

# Edits scenes at random while Live Preview follows, and compares each with a full bake: STEPS edits, from SEED on.
STEPS ?= 10000
SEED ?= 1
random-edits: venv
	$(RUN) tools/random_edits.py --steps $(STEPS) --seed $(SEED)

bench: venv
	$(RUN) benchmarks/run.py

# Every .blend below DIR with every target; tables of what became of them in build/bake_folder.
bake-folder: venv
	$(RUN) tools/bake_folder.py "$(DIR)"

figures: venv
	$(RUN) benchmarks/figures.py

samples: venv
	$(RUN) sample_blends/make_samples.py

clean:
	rm -rf demo build .venv .venv-*
