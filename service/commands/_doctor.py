"""`luxmeter doctor`: is all there that luxmeter needs?"""

from __future__ import annotations

from dataclasses import asdict

from jobs.doctor import check_all
from service.options import Json
from service.output import print_json, print_table


def doctor(json: Json = False) -> int:
    """Check this machine; exit code 1, with the fix, when something required is missing."""
    checks = check_all()
    healthy = all(check.ok for check in checks if check.required)
    if json:
        print_json({"ok": healthy, "checks": [asdict(check) for check in checks]})
    else:
        rows = [(c.name, "ok" if c.ok else "missing" if c.required else "optional", c.found, "" if c.ok else c.fix) for c in checks]
        print_table(("requirement", "state", "found", "fix"), rows)
    return 0 if healthy else 1
