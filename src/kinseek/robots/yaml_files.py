"""Read YAML of limited size, without objects of Python."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from kinseek.errors import InvalidRobot
from kinseek.support.interrupts import raise_of_handler

from .expressions import MOST_DIGITS, MOST_ENTRIES
from .files import file_bytes, require_few
from .xacro_limits import MOST_NESTED


def read_yaml(path: Path, most: int, tags: Mapping[str, Callable[..., Any]] | None = None) -> Any:
    """Read a YAML file.

    Args:
        path: The file.
        most: Largest allowed size in bytes; PyYAML reads some 100 kB a second.
        tags: Constructors of further tags, as in `yaml_content`.

    Raises:
        InvalidRobot: The file cannot be read, is not YAML, has a key twice, or is too large, as it is or with its aliases
            expanded.
    """
    text = file_bytes(path, most)
    try:
        return yaml_content(text, str(path), tags, unique=True)
    except InvalidRobot:
        raise
    except RecursionError:
        raise InvalidRobot(f"{path}: the values are nested too deeply") from None
    except Exception as error:
        # PyYAML raises anything for a value that does not fit its tag, as in `!!bool x`.
        raise_of_handler(error)
        raise InvalidRobot(f"{path}: broken YAML: {error}") from None


def yaml_content(
    text: bytes, where: str, tags: Mapping[str, Callable[..., Any]] | None = None, *, unique: bool = False
) -> Any:
    """Read YAML, unless it is large with its aliases and merges expanded.

    Args:
        text: The file.
        where: The file, for messages.
        tags: Constructors of further tags, such as those of xacro for units, ``!degrees``.
        unique: Refuse a key that one mapping has twice, which YAML forbids and PyYAML accepts: the last value counts.

    Raises:
        InvalidRobot: The file has a number with too many digits, too many entries when expanded, or too many brackets
            around one value; or, if `unique`, a key twice.
        yaml.YAMLError: The text is not YAML.
    """
    import yaml  # type: ignore[import-untyped]

    class Loader(yaml.SafeLoader):  # type: ignore[misc]
        """A separate class, so that the tags are not added to the loader of other programs."""

        def fetch_flow_collection_start(self, token: Any) -> None:
            # At each word PyYAML goes through all brackets around it.
            require_few(self.flow_level + 1, "brackets around one value", MOST_NESTED, where)
            super().fetch_flow_collection_start(token)

    for tag, constructor in (tags or {}).items():
        Loader.add_constructor(tag, constructor)
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
                if unique and isinstance(node, yaml.MappingNode):
                    _require_unique([key for key, _ in node.value], where)
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


def _require_unique(keys: Sequence[Any], where: str) -> None:
    """Refuse a mapping, given the nodes of its keys, in which a word is a key twice."""
    lines: dict[str, int] = {}
    for key in keys:
        if not isinstance(key.value, str):  # A list or a mapping.
            continue
        line = key.start_mark.line + 1
        if key.value in lines:
            raise InvalidRobot(
                f"{where}: lines {lines[key.value]} and {line} both give the key {key.value!r}"
            )
        lines[key.value] = line
