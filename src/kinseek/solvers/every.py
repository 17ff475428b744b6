"""All searches, imported."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from . import MODULES

if TYPE_CHECKING:
    from .traits import OwnSolver

ALL_SOLVERS: tuple[type[OwnSolver], ...] = tuple(
    getattr(importlib.import_module(module, __package__), name) for name, module in MODULES.items()
)
