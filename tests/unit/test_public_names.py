"""The names that `renderers` offers: importing a part of the package must not change what one of them means."""

from __future__ import annotations

import subprocess
import sys


def test_no_public_name_is_also_a_module() -> None:
    code = """
import pkgutil, renderers
offered = {name: getattr(renderers, name) for name in renderers.__all__}
assert renderers.registered_methods()  # imports every method
assert not set(renderers.__all__) & {module.name for module in pkgutil.iter_modules(renderers.__path__)}
assert all(getattr(renderers, name) is meaning for name, meaning in offered.items())
"""
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)
