# Everything is installed into $(VENV), in this folder; nothing else on the machine is touched.
PYTHON ?= python3
VENV ?= .venv
BLENDER_VENV ?= .venv-blender
OUT ?= out
RAYS ?= 1e8
GATHERS ?= 1e6
MESSAGES ?= 1e6
RENDERS ?= 1e3
CHAOS ?= kill=200,kills=12,term=40,cut=16,stop=8,minute=3,delay=4,slow=4,flaky=4,half-open=2,disk=6,masters=20
RESUME ?=
CHAOS_SCALE ?= 1
RENDERS_SOAK ?= 30
SEED ?= 1
JOBS ?= auto
DEVICE ?= cuda:0

BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check

.DELETE_ON_ERROR:
.PHONY: help demo test test-slurm test-dask test-ssh chaos soak test-blender test-notebook release-check fuzz hard-cases guards lint handbook gallery peers gpu-check gpu-table clean

help:  ## show this list
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1\t\2/p' Makefile | expand -t 16

demo: $(VENV)/.installed  ## render a Cornell box with a master and four slaves
	@mkdir -p $(OUT)
	@echo "1 of 3: a small picture, which also compiles the kernels (once; up to a minute)"
	$(BIN)/wdpm render cornell-box --size 256x256 --spp 4 --photons 100k -q -o $(OUT)/cornell-box-first.png
	@echo "        $(abspath $(OUT))/cornell-box-first.png"
	@echo "2 of 3: a larger one, by a master and four slaves"
	$(BIN)/wdpm render cornell-box --slaves 4 --photons 1M --k 100 -o $(OUT)/cornell-box.exr -o $(OUT)/cornell-box.png
	@echo
	@echo "        $(abspath $(OUT))/cornell-box.png; all layers are in cornell-box.exr"
	@echo "3 of 3: kernels for all effects, so that later scenes need not compile any (once; a minute of one core)"
	$(BIN)/wdpm doctor --prepare > $(OUT)/doctor.txt
	@echo "Done. Next: . $(BIN)/activate; wdpm --help; docs/first-picture.md"

# pytest prints the seed of the order; `pytest --randomly-seed=SEED` repeats it, `pytest -p no:randomly` keeps files' order.
# Of work that is left, a free worker takes half of another's: files stay together, and what they prepare once as well.
# Tests of processes that failed beside others are run once more, alone, and told of: tests/run_tests.py says which.
test: $(VENV)/.installed-test  ## run the tests (those marked slow are left out) in random order on JOBS cores
	$(BIN)/python tests/compile_kernels.py
	$(BIN)/python tests/run_tests.py -m "not slow and not slurm and not dask and not sshd" -n $(JOBS) --dist worksteal

test-blender:  ## compare the add-on with Cycles in Blender's module (Python 3.11; its own VENV=.venv-blender)
	$(MAKE) VENV=$(BLENDER_VENV) $(BLENDER_VENV)/.installed-blender
	$(BLENDER_VENV)/bin/python -m pytest tests/blender

test-notebook: $(VENV)/.installed-notebook  ## execute the notebooks of the documentation by a kernel
	$(BIN)/python -m pytest tests/notebook

test-slurm: $(VENV)/.installed-test  ## test under a real Slurm, which is installed and started here (Debian, root)
	@command -v slurmctld && command -v munged || { apt-get update && apt-get install -y slurm-wlm munge; }
	$(BIN)/python -m pytest -m slurm tests/slurm

test-dask: $(VENV)/.installed-dask  ## test on a real Dask cluster of processes
	$(BIN)/python -m pytest -m dask tests/on_dask

test-ssh: $(VENV)/.installed-test  ## test with a real sshd, which is installed and started here (Debian, root)
	@command -v sshd && command -v ssh-keygen || { apt-get update && apt-get install -y openssh-server; }
	$(BIN)/python -m pytest -m sshd tests/placing

fuzz: $(VENV)/.installed-test  ## fuzz rays, routing and gathers against brute force, and the wire (RAYS, GATHERS, MESSAGES, RENDERS, SEED)
	$(BIN)/python tests/fuzz/run.py --rays $(RAYS) --gathers $(GATHERS) --messages $(MESSAGES) \
		--renders $(RENDERS) --seed $(SEED) -o $(OUT)/fuzz

chaos: $(VENV)/.installed-test  ## render under faults of slaves, links, disks and masters, and compare all bits: an hour (CHAOS, CHAOS_SCALE, SEED, RESUME=--resume, WDPM_SCENES)
	CHAOS_SCALE=$(CHAOS_SCALE) $(BIN)/python tests/chaos/run.py --renders $(CHAOS) --seed $(SEED) $(RESUME) -o $(OUT)/chaos

soak: $(VENV)/.installed-test  ## render again and again with one cluster: its memory must not grow (RENDERS_SOAK)
	$(BIN)/python tests/chaos/soak.py --renders $(RENDERS_SOAK) -o $(OUT)/soak

hard-cases: $(VENV)/.installed-test  ## run the hard cases in full and write out/hard-cases/index.html (WDPM_SCENES)
	$(BIN)/python tests/hard_cases/run.py -o $(OUT)/hard-cases

guards: $(VENV)/.installed-test  ## take each guard away in a copy, and show that its tests fail (hours)
	$(BIN)/python tests/guards/remove_guards.py

release-check: $(VENV)/.installed-notebook $(VENV)/.installed-peers  ## build the wheel, run the tests, say what a release lacks
	rm -rf $(OUT)/release
	$(BIN)/python -m build --wheel --outdir $(OUT)/release .
	$(BIN)/python -m pytest -m "not slow" -n $(JOBS) --dist worksteal --junitxml=$(OUT)/release/tests.xml || true
	$(BIN)/python tests/release/release_check.py --wheel $(OUT)/release --tests $(OUT)/release/tests.xml

lint: $(VENV)/.installed-test  ## check style, types and directions of imports
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy -p wdpm
	$(BIN)/lint-imports --no-cache

handbook: $(VENV)/.installed-docs  ## build the handbook, with warnings as errors -> out/handbook/index.html
	$(BIN)/python -m sphinx -W --keep-going -q -a -E -c docs/handbook docs $(OUT)/handbook
	@echo "The handbook is $(abspath $(OUT))/handbook/index.html."

gallery: $(VENV)/.installed  ## render the gallery anew, and write docs/gallery.md with its times (a quarter of an hour)
	$(BIN)/python docs/make_gallery.py

gpu-check: $(VENV)/.installed  ## compare a GPU's bits and times with the CPU's: ten minutes (DEVICE, WDPM_SCENES)
	@mkdir -p $(OUT)
	$(BIN)/wdpm bench device --device $(DEVICE) --json $(OUT)/gpu-check.json --markdown $(OUT)/gpu-check.md

gpu-table: $(VENV)/.installed-cuda  ## compile all kernels for GPUs, without one, and write registers and memory
	@mkdir -p $(OUT)
	$(BIN)/wdpm bench cuda --json $(OUT)/gpu-table.json --markdown $(OUT)/gpu-table.md

peers: $(VENV)/.installed-peers  ## install the renderers that wdpm is compared with

clean:  ## remove what was built and rendered, and the virtual environment
	rm -rf $(VENV) $(BLENDER_VENV) $(OUT) build dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis
	find wdpm kernels cluster scenes tests -name __pycache__ -type d -prune -exec rm -rf {} +

# The stamps are older than pyproject.toml when what is to be installed may have changed.
$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
		echo "wdpm needs Python 3.11 or newer; $(PYTHON) is `$(PYTHON) --version 2>&1`."; \
		echo "Name another one, for example: make demo PYTHON=python3.12"; exit 1; }
	@$(PYTHON) -c 'import ensurepip' 2>/dev/null || { \
		echo "$(PYTHON) cannot make virtual environments; on Debian and Ubuntu: apt install python3-venv"; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: pyproject.toml | $(BIN)/python
	@echo "Installing wdpm and what it needs into $(VENV) (once; some minutes on a slow line)"
	$(PIP) install --quiet -e .
	@touch $@

$(VENV)/.installed-test: pyproject.toml | $(BIN)/python
	@echo "Installing wdpm, what it needs and what its tests need into $(VENV) (once; some minutes on a slow line)"
	$(PIP) install --quiet -e '.[test]'
	@touch $@ $(VENV)/.installed

$(VENV)/.installed-blender: pyproject.toml | $(BIN)/python
	@echo "Installing wdpm, its tests and Blender's module into $(VENV) (once; 350 MB)"
	$(PIP) install --quiet -e '.[test,blender]'
	@touch $@

$(VENV)/.installed-notebook: pyproject.toml | $(BIN)/python
	@echo "Installing wdpm, its tests and what runs notebooks into $(VENV)"
	$(PIP) install --quiet -e '.[test,notebook]'
	@touch $@ $(VENV)/.installed $(VENV)/.installed-test

$(VENV)/.installed-dask: pyproject.toml | $(BIN)/python
	@echo "Installing wdpm, its tests and Dask into $(VENV)"
	$(PIP) install --quiet -e '.[test,dask]'
	@touch $@ $(VENV)/.installed $(VENV)/.installed-test

$(VENV)/.installed-cuda: pyproject.toml | $(BIN)/python
	@echo "Installing wdpm and NVIDIA's assembler into $(VENV)"
	$(PIP) install --quiet -e '.[cuda]'
	@touch $@ $(VENV)/.installed

$(VENV)/.installed-docs: pyproject.toml | $(BIN)/python
	@echo "Installing wdpm and what makes its handbook into $(VENV)"
	$(PIP) install --quiet -e '.[docs]'
	@touch $@ $(VENV)/.installed

$(VENV)/.installed-peers: pyproject.toml | $(BIN)/python
	@echo "Installing Mitsuba, Embree and SciPy into $(VENV)"
	$(PIP) install --quiet -e '.[peers]'
	@touch $@ $(VENV)/.installed
