"""Write the README's table of methods from the registry; with --check only say whether it is up to date."""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from renderers import Method, registered_methods  # noqa: E402

BEGIN, END = "<!-- methods: begin -->\n", "<!-- methods: end -->\n"


def row(method: Method) -> str:
    """One line of the table; the name links to the method's page where there is one."""
    page = Path("docs") / "methods" / f"{method.name}.md"
    name = f"[`{method.name}`]({page.as_posix()})" if (ROOT / page).is_file() else f"`{method.name}`"
    return f"| {name} | {method.title} | {method.transport(method.Settings())} | {method.source} |\n"


def table() -> str:
    """The whole table."""
    head = "| method | what it is | light paths | source |\n| --- | --- | --- | --- |\n"
    own = (m for m in registered_methods().values() if type(m).__module__.startswith("renderers.methods."))
    return head + "".join(map(row, own))


def main() -> int:
    """Rewrite README.md; with --check leave it and return 1 where it differs."""
    path = ROOT / "README.md"
    text = path.read_text(encoding="utf-8")
    before, rest = text.split(BEGIN)
    after = rest.split(END)[1]
    fresh = before + BEGIN + table() + END + after
    if "--check" in sys.argv:
        if fresh != text:
            print("README.md: the table of methods is out of date; run scripts/readme_table.py", file=sys.stderr)
        return int(fresh != text)
    path.write_text(fresh, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
