"""``--solver`` and its options, generated from the fields of the searches."""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Any, get_args, get_origin, get_type_hints

from kinseek.errors import InvalidSolver, suggest
from kinseek.solvers.base import Solver
from kinseek.solvers.every import ALL_SOLVERS
from kinseek.solvers.traits import OwnSolver, summary

from .help import option, together
from .words import option_of

READABLE = (bool, int, float, str, NoneType)


@dataclass(frozen=True)
class Parameter:
    """A field of a search that can be set on the command line."""

    name: str
    types: tuple[Any, ...]
    """Its possible types, with unions split into their members."""
    default: object
    owner: type
    """The search."""

    @property
    def help(self) -> str:
        """The field's docstring, read from the source when it is needed, because that takes longer than a search."""
        return _docstrings(self.owner).get(self.name, "")

    @property
    def option(self) -> str:
        """Its form on the command line."""
        return option_of(self.name)


@cache
def searches() -> dict[str, type[OwnSolver]]:
    """Return the searches by their names on the command line."""
    return {re.sub(r"(?<=[a-z])(?=[A-Z])", "-", cls.__name__).lower(): cls for cls in ALL_SOLVERS}


@cache
def searches_in_words() -> str:
    """Return the searches with a description of each, for help."""
    words = [f"{name}: {summary(cls)}" for name, cls in searches().items()]
    return f"{'. '.join(words)}. Default: atlas."


@cache
def parameters(search: str) -> dict[str, Parameter]:
    """Return the fields of a search that can be set on the command line; a nested search is excluded."""
    cls: Any = searches()[search]
    hints = get_type_hints(cls)
    found = {}
    for item in fields(cls):
        hint = hints[item.name]
        types = get_args(hint) if isinstance(hint, UnionType) else (hint,)
        if item.default is not MISSING and all(t in READABLE or get_origin(t) is tuple for t in types):
            found[item.name] = Parameter(item.name, types, item.default, cls)
    return found


def search_options(only: Sequence[str] = ()) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Give a command one option for every field of all searches, or of some; they arrive as keyword arguments."""
    owners: dict[str, list[str]] = {}
    for search in only or searches():
        for name in parameters(search):
            owners.setdefault(name, []).append(search)
    return together(
        *(_option([parameters(search)[name] for search in owning], owning) for name, owning in owners.items())
    )


def make_search(search: str | None, given: Mapping[str, object]) -> Solver | None:
    """Build the requested search; None if none is requested, and the arm then uses its own.

    Args:
        search: Name of the search.
        given: Values of the options from Click, None for an option that was not given.

    Raises:
        InvalidSolver: An unknown search, an option of another search, or a value out of its range.
    """
    named = {name: value for name, value in given.items() if value is not None}
    if search is None:
        if not named:
            return None
        first = next(iter(named))
        owners = [name for name in searches() if first in parameters(name)]
        raise InvalidSolver(f"{option_of(first)} needs --solver {' or '.join(owners)}")
    if search not in searches():
        raise InvalidSolver(suggest(search, searches(), "solver"))
    own = parameters(search)
    for name in named:
        if name not in own:
            valid = ", ".join(parameter.option for parameter in own.values()) or "none"
            raise InvalidSolver(f"{search} has no option {option_of(name)}. Its options: {valid}")
    return searches()[search](**{name: _read(own[name], value) for name, value in named.items()})


def _option(same: list[Parameter], owners: list[str]) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    first = same[0]

    def described() -> str:
        notes = _by_owner(owners, [parameter.help for parameter in same])
        defaults = _by_owner(owners, [str(parameter.default) for parameter in same])
        text = " ".join(f"({who}) {note}" if who else note for note, who in notes.items() if note)
        values = ", ".join(f"{value} ({who})" if who else value for value, who in defaults.items())
        return f"{text} Default: {values}.".strip().replace("`", "")

    group = f"Options of --solver {', '.join(owners)}"
    if first.types == (bool,):
        return option(
            f"{first.option}/--no-{first.option[2:]}",
            first.name,
            default=None,
            group=group,
            lazy_help=described,
        )
    return option(first.option, first.name, metavar=_shape(first), group=group, lazy_help=described)


def _by_owner(owners: Sequence[str], texts: Sequence[str]) -> dict[str, str]:
    """Return each different text with the searches that have it; without searches if all have the same text."""
    who: dict[str, list[str]] = {}
    for owner, text in zip(owners, texts, strict=True):
        who.setdefault(text, []).append(owner)
    return {text: ", ".join(names) if len(who) > 1 else "" for text, names in who.items()}


def _shape(parameter: Parameter) -> str:
    names = {int: "N", float: "X", str: "WORD", NoneType: "none"}
    return "|".join(names.get(t, "N,N,…") for t in parameter.types)


def _read(parameter: Parameter, value: object) -> object:
    if not isinstance(value, str):
        return value
    for kind in sorted(parameter.types, key=lambda t: t is str):  # A word only if no number fits.
        try:
            if kind is NoneType and value.lower() == "none":
                return None
            if kind in (int, float, str):
                return kind(value)
            if get_origin(kind) is tuple and "," in value:
                each = get_args(get_args(kind)[0]) or get_args(kind)[:1]
                return tuple(_part(part, each) for part in value.split(","))
        except ValueError:
            continue
    raise InvalidSolver(f"{parameter.option} takes {_shape(parameter)}, got {value!r}")


def _part(text: str, kinds: tuple[type, ...]) -> object:
    """Read the value for one joint.

    Raises:
        ValueError: It has none of these types.
    """
    if NoneType in kinds and text.strip().lower() == "none":
        return None
    return next(kind for kind in kinds if kind is not NoneType)(text)


@cache
def _docstrings(cls: type) -> dict[str, str]:
    """Return the docstrings below the fields of a class and of its base classes, by field."""
    notes = {}
    for owner in reversed([each for each in cls.__mro__ if is_dataclass(each)]):
        (tree,) = ast.parse(textwrap.dedent(inspect.getsource(owner))).body
        assert isinstance(tree, ast.ClassDef)
        for field, note in zip(tree.body, tree.body[1:], strict=False):
            match field, note:
                case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(text))):
                    notes[name] = " ".join(text.replace("``", "").split())
    return notes
