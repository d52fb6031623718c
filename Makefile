# `make demo` and `make test` do everything on a fresh machine with Python 3.11 and make.
PYTHON ?= python3
BIN := .venv/bin
DEMO := demo
DENSITIES := 1 5 10 15 20 25 30

.PHONY: setup demo test lint clean
setup: .venv/.installed

.venv/.installed: pyproject.toml constraints.txt tools/install_system_libraries.sh
	sh tools/install_system_libraries.sh
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet -c constraints.txt -e '.[dev]'
	touch $@

demo: setup
	$(BIN)/drl-av train --preset fast --out $(DEMO)/fast $(if $(wildcard $(DEMO)/fast/config.toml),--resume)
	$(BIN)/drl-av evaluate $(DEMO)/fast --driver pretrained idm idm-sumo \
	    --vehicles $(DENSITIES) --episodes 20 --jobs 2 --out $(DEMO)/evaluation.csv
	$(BIN)/drl-av figures $(DEMO)/evaluation.csv $(DEMO)/fast --out $(DEMO)
	$(BIN)/drl-av replay $(DEMO)/fast --vehicles 15 --seed 1 --decisions 60 --video $(DEMO)/drive.mp4
	@echo "See $(DEMO)/mean_speed.png and $(DEMO)/drive.mp4"

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

test: lint
	$(BIN)/python -m pytest -n 2

clean:
	rm -rf .venv $(DEMO)
