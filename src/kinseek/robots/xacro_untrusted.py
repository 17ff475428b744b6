"""Expressions and YAML files of xacro files that are not trusted: no Python runs, and the environment is not read."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from kinseek.errors import InvalidRobot

from .expressions import Refused, evaluate
from .xacro_limits import FORMULA, YAML, Changes, Spend
from .yaml_files import yaml_content


def evaluation(path: Path, spend: Spend) -> tuple[Changes, ...]:
    """Return what replaces Python's `eval` and the environment in xacro.

    Args:
        path: The file, for messages.
        spend: Counts units of work.

    Returns:
        The names to replace; xacro has no other way to change them.
    """
    from xacro import substitution_args  # type: ignore[import-untyped]
    from xacrodoc.xacrodoc import xacro

    contents: dict[str, Any] = {}
    units = {unit.value.tag: unit.constructor for unit in xacro.ConstructUnits}

    def load_yaml(name: str) -> Any:
        # All callers share one content: expressions that are evaluated here cannot change it.
        file = xacro.abs_filename_spec(name)
        if file not in contents:
            with xacro.open(file, "rb") as opened:
                text = opened.read()
            spend(YAML * len(text), "YAML files")
            xacro.filestack.append(file)
            try:
                contents[file] = yaml_content(text, f"{path}: {name}", units)
            finally:
                xacro.filestack.pop()
        return contents[file]

    def compute(expression: str, names: Any, functions: Mapping[str, Any]) -> Any:
        spend(FORMULA * len(expression), "expressions")
        try:
            return evaluate(expression, names, functions, lambda units: spend(units, "expressions"))
        except Refused as refused:
            raise InvalidRobot(
                f"{path}: xacro: {expression.strip()[:80]!r} holds {refused}; in a file that is not trusted only "
                "simple expressions are computed. If you trust the file, give trusted=True"
            ) from None

    def safe_eval(expression: str, names: Any, inner: Any = None) -> Any:
        arguments = xacro.substitution_args_context["arg"]
        own = {"load_yaml": load_yaml, "dotify": lambda value: value, "abs_filename": xacro.abs_filename_spec}
        own["arg"] = lambda name: arguments[name]
        return compute(expression, names, own | {f"xacro.{name}": function for name, function in own.items()})

    def eval_extension(expression: str, context: Any) -> str:
        given = substitution_args._DictWrapper(context.setdefault("arg", {}), {})
        functions = {
            "arg": given.__getitem__,
            "dirname": lambda: substitution_args._eval_dirname(context["filename"]),
        }
        return str(compute(expression, given, functions))

    def unknown(name: str) -> str:
        raise InvalidRobot(
            f"{path}: xacro: $(env {name}): the environment is not read for a file that is not trusted"
        )

    return (
        (xacro, {"safe_eval": safe_eval}),
        (
            substitution_args,
            {"_eval": eval_extension, "_eval_env": unknown, "_eval_optenv": lambda name, default="": default},
        ),
    )
