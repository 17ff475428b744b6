"""Names of a package that are imported when they are first asked for, so that an answer does not wait for them."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from typing import Any


def lazy_names(
    package: dict[str, Any], modules: Mapping[str, str]
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """What a package has as its `__getattr__` and its `__dir__` (PEP 562).

    Args:
        package: Its `globals()`: a name that was asked for once is kept there.
        modules: Module of each name, as the package would import it: ``{"Scene": ".collision"}``. If it is of that name,
            it is what is meant: ``{"collision": ".collision"}``.
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
