"""Names of a package that are imported at their first use, so that importing the package stays fast."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from typing import Any


def lazy_names(
    package: dict[str, Any], modules: Mapping[str, str]
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return the `__getattr__` and `__dir__` of a package with lazy names (PEP 562).

    Args:
        package: Its `globals()`: a name is stored there after its first use.
        modules: Module of each name, as the package would import it: ``{"Scene": ".collision"}``. If the module has the same
            name, the name is the module itself: ``{"collision": ".collision"}``.
    """

    def imported(name: str) -> Any:
        if name not in modules:
            raise AttributeError(f"module {package['__name__']!r} has no attribute {name!r}", name=name)
        module = importlib.import_module(modules[name], package["__name__"])
        package[name] = module if modules[name] == f".{name}" else getattr(module, name)
        return package[name]

    def names() -> list[str]:
        return sorted({*package, *modules})

    return imported, names
