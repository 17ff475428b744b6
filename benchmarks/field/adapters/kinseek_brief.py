"""kinseek without a search for the nearest pose; named on demand, since it differs from `kinseek` only out of reach."""

from benchmarks.field.adapters.kinseek import PACKAGE, SWEEP, load

__all__ = ["NAME", "PACKAGE", "RECOMMENDED", "SWEEP", "load"]

NAME, RECOMMENDED = "kinseek, nearest=False", {"nearest": False}
