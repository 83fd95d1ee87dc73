PYTHON := .venv/bin/python
SIZE := 160x90
NOISE := 0.02
DEMO := out/demo

.PHONY: install demo test slow check gallery examples bench lock clean

install:  ## system libraries, .venv and the luxmeter command
	@scripts/install

demo: install  ## two scenes, two methods, one report
	@rm -rf $(DEMO)
	.venv/bin/luxmeter evaluate --scene cornell-box --scene cornell-glossy --method ir --method pt --set pt.spp=64 --size $(SIZE) --noise $(NOISE) --out $(DEMO)

test:  ## all tests but the slow ones
	@scripts/install --tests
	nice -n 19 $(PYTHON) scripts/compile_kernels.py & $(PYTHON) -m pytest

slow:  ## the slow tests of the nightly suite
	@scripts/install --tests
	$(PYTHON) -m pytest -m slow

check: install  ## format, lint, types, import rule, generated text
	$(PYTHON) -m ruff format --check .
	$(PYTHON) -m ruff check .
	$(PYTHON) -m mypy
	.venv/bin/lint-imports
	$(PYTHON) scripts/readme_table.py --check

gallery: install  ## one contact sheet: methods × scenes, each beside its reference and its error
	PYTHONPATH=. $(PYTHON) scripts/gallery.py --out gallery

examples: install  ## run every numbered example; their pictures go to out/examples
	@mkdir -p out/examples
	@for example in examples/[0-9]*.py; do echo $$example; (cd out/examples && ../../$(PYTHON) ../../$$example) || exit 1; done

bench: install  ## timings of the parts; informative, never a test
	@for script in benchmarks/*.py; do echo $$script; $(PYTHON) -m benchmarks.$$(basename $$script .py) || exit 1; done

lock: install  ## resolve pyproject.toml anew, keeping what requirements.lock pins
	$(PYTHON) -m uv pip compile pyproject.toml --extra dev --universal --python-version 3.11 --generate-hashes --no-emit-index-url --no-annotate --no-header --quiet --output-file requirements.lock

clean:
	rm -rf .venv out gallery build *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
