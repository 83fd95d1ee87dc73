"""Child process that compares two runs: `python -m service.http.comparing MEMORY SECONDS BEFORE AFTER OUT` (BEFORE may be empty).

OUT gets `comparison.json`, `viewers.json` (what the image viewers need to know, by row) and `assets/` (their images).
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from service.http.limited import answer, limit_this_process

COMPUTED = {"counts", "regressed"}


def main(arguments: list[str]) -> int:
    """0 when OUT is written or a run refused; a crash is the parent's to tell."""
    memory, seconds, before, after, out = arguments
    limit_this_process(int(memory), int(seconds))
    from pydantic import ValidationError

    from jobs.errors import one_line

    try:
        write(Path(before) if before else None, Path(after), Path(out))
        answer({})
    except (OSError, ValidationError) as error:
        answer({"error": one_line(error) if isinstance(error, ValidationError) else str(error)})
    except MemoryError:
        answer({"error": f"needs more than {int(memory) / 2**20:.0f} MiB of memory"})
    return 0


def write(before: Path | None, after: Path, out: Path) -> None:
    """Compare and write. Raises OSError where a run's files are not those it was made with."""
    from reports import regression, regression_page

    for folder in filter(None, (before, after)):
        check(folder)
    comparison = regression.compare(before, after)
    viewers = regression_page.write_images(comparison, before, after, out / "assets")
    (out / "viewers.json").write_text(json.dumps(viewers))
    (out / "comparison.json").write_text(comparison.model_dump_json(exclude=COMPUTED))


def check(folder: Path) -> None:
    """Raises OSError where a run's files changed after the run; an evaluation's come from the store, which checks them itself."""
    from reports.runs import digest, read_run

    if (folder / "run.json").is_file() and digest(folder) != read_run(folder).digest:
        raise OSError(f"the run {folder.name} was altered after it was made")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
