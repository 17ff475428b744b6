"""Expressions and YAML files of xacro files that are not trusted: no Python runs, and the environment is not read."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from kinseek.errors import InvalidRobot

from .expressions import MOST_DIGITS, MOST_ENTRIES, Refused, evaluate
from .files import require_few
from .xacro_limits import FORMULA, MOST_NESTED, YAML, Changes, Spend


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

    def load_yaml(name: str) -> Any:
        # All callers share one content: expressions that are evaluated here cannot change it.
        file = xacro.abs_filename_spec(name)
        if file not in contents:
            with xacro.open(file, "rb") as opened:
                text = opened.read()
            spend(YAML * len(text), "YAML files")
            xacro.filestack.append(file)
            try:
                contents[file] = _yaml_content(text, xacro.ConstructUnits, f"{path}: {name}")
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


def _yaml_content(text: bytes, units: Any, where: str) -> Any:
    """Read YAML as xacro does, unless it is large with its aliases and merges expanded.

    Args:
        text: The file.
        units: xacro's tags for units, such as ``!degrees``.
        where: The file, for messages.

    Raises:
        InvalidRobot: The file has a number with too many digits, too many entries when expanded, or too many brackets
            around one value.
        yaml.YAMLError: The text is not YAML.
    """
    import yaml  # type: ignore[import-untyped]

    class Loader(yaml.SafeLoader):  # type: ignore[misc]
        """A separate class, so that the tags for units are not added to the loader of other programs."""

        def fetch_flow_collection_start(self, token: Any) -> None:
            # At each word PyYAML goes through all brackets around it.
            require_few(self.flow_level + 1, "brackets around one value", MOST_NESTED, where)
            super().fetch_flow_collection_start(token)

    for unit in units:
        Loader.add_constructor(unit.value.tag, unit.constructor)
    sizes: dict[Any, int] = {}

    def written(node: Any) -> int:
        """Return the number of entries with all aliases expanded; a merge counts as the map that it refers to."""
        if node not in sizes:
            # The value until it is known: a list that contains itself never ends.
            sizes[node] = MOST_ENTRIES + 1
            if isinstance(node, yaml.ScalarNode):
                if node.tag.endswith((":int", ":float")):
                    require_few(len(node.value), "digits of one number", MOST_DIGITS, where)
                sizes[node] = 1 + len(node.value) // 64
            else:
                inner = (
                    one for entry in node.value for one in (entry if isinstance(entry, tuple) else (entry,))
                )
                sizes[node] = min(1 + sum(map(written, inner)), MOST_ENTRIES + 1)
        return sizes[node]

    loader = Loader(text)
    try:
        node = loader.get_single_node()
        if node is None:
            return None
        require_few(written(node), "entries of a YAML file", MOST_ENTRIES, where)
        return loader.construct_document(node)
    finally:
        loader.dispose()
