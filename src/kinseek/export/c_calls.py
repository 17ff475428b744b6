"""C functions of the declared entries, with typed arguments; they build the table of arguments inside."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from kinseek.kernels import jit  # Not by name: naming its decorators marks a file of kernels.
from kinseek.kernels.entry import Bundle, Dimension, Entry, Leaf

_C = {"f": "double", "i": "int64_t", "b": "bool"}
_ROUTINE_C = {"float64": "double", "int64": "int64_t"}


def c_declarations(entries: Iterable[Entry]) -> str:
    """Return structures and prototypes, each with a comment on its dimensions."""
    declared = list(entries)
    bundles: dict[str, Bundle] = {}
    for one in declared:
        bundles |= {name_of(each): each for each in one.takes.values() if isinstance(each, Bundle)}
    parts = [_structure(name, one) for name, one in bundles.items()]
    return "\n\n".join([*parts, *(f"{_comment(one)}\n{_prototype(one)};" for one in declared)])


def c_definitions(entries: Iterable[Entry]) -> str:
    """Return the definitions of the functions."""
    return "\n\n".join(map(_function, entries))


def prototype(routine: jit.Routine) -> str:
    """Return the C prototype of a routine.

    In WebAssembly functions have types, so a routine's address is only valid with its prototype.
    """
    result, _, given = routine.signature.rstrip(")").partition("(")
    each = (_ROUTINE_C[word.strip()] for word in given.split(","))
    return f"extern {_ROUTINE_C[result]} {routine.name}({', '.join(each)});"


def name_of(bundle: Bundle) -> str:
    """Return the C name of a bundle."""
    return f"Kinseek{bundle.made_of.__name__}"


def _lengths(name: str, leaf: Leaf) -> list[str]:
    """Return the names of the lengths that only this array has."""
    free = [i for i, each in enumerate(leaf.shape) if each.name == "*"]
    return [f"{name}_length" if len(free) == 1 else f"{name}_length{i}" for i in free]


def _member(name: str, leaf: Leaf) -> list[str]:
    """Return type and name of a number or an array in C, and of lengths that only it has."""
    if not leaf.shape:
        return [f"{_C[leaf.element]} {name}"]
    const = "" if leaf.written else "const "
    return [f"{const}{_C[leaf.element]} *{name}", *(f"int64_t {each}" for each in _lengths(name, leaf))]


def _structure(name: str, bundle: Bundle) -> str:
    lines = []
    for field, leaf in bundle.fields.items():
        if isinstance(leaf, Bundle):
            raise TypeError(f"{name}.{field}: a bundle in a bundle has no C structure yet")
        shape = f"  /* {_shape(leaf)} */" if leaf.shape else ""
        lines.append(f"    {'; '.join(_member(field, leaf))};{shape}")
    return "\n".join(["typedef struct {", *lines, f"}} {name};"])


def _shape(leaf: Leaf) -> str:
    return f"({', '.join(map(str, leaf.shape))}{',' * (len(leaf.shape) == 1)})"


def _named(one: Entry) -> list[str]:
    """Return the names of the dimensions that are shared in a whole call."""
    each = (d.name for _, leaf in one.leaves() for d in leaf.shape)
    return list(dict.fromkeys(name for name in each if name and name != "*"))


def _parameters(one: Entry) -> Iterator[str]:
    yield from (f"int64_t {name}" for name in _named(one))
    for name, what in one.takes.items():
        if isinstance(what, Bundle):
            yield f"const {name_of(what)} *{name}"
        else:
            yield from _member(name, what)
    for i, leaf in enumerate(one.returns):
        yield f"{_C[leaf.element]} *{_result(one, i)}"


def _result(one: Entry, i: int) -> str:
    return "result" if len(one.returns) == 1 else f"result{i}"


def _prototype(one: Entry) -> str:
    return f"int32_t kinseek_{one.function.__name__}({', '.join(_parameters(one)) or 'void'})"


def _comment(one: Entry) -> str:
    first = (one.function.__doc__ or "").strip().partition("\n")[0].replace("`", "")
    shapes = [
        f"{name} {_shape(what)}" for name, what in one.takes.items() if isinstance(what, Leaf) and what.shape
    ]
    words = f"{first} Shapes: {', '.join(shapes)}." if shapes else first
    return f"/* {words} Returns 0, or Numba's number of a failure. */"


def _slots(one: Entry) -> Iterator[str]:
    for name, what in one.takes.items():
        if isinstance(what, Leaf):
            yield from _value(name, name, "", what)
            continue
        for field, leaf in what.fields.items():
            assert isinstance(leaf, Leaf)
            yield from _value(f"{name}->{field}", field, f"{name}->", leaf)


def _value(expression: str, name: str, owner: str, leaf: Leaf) -> Iterator[str]:
    if not leaf.shape:
        yield f"kinseek_bits({expression})" if leaf.element == "f" else expression
        return
    yield f"(int64_t)(uintptr_t){expression}"
    lengths = iter(_lengths(name, leaf))
    for dimension in leaf.shape:
        yield f"{owner}{next(lengths)}" if dimension.name == "*" else _length(dimension)


def _length(dimension: Dimension) -> str:
    return f"{dimension.name} + {dimension.plus}" if dimension.name and dimension.plus else str(dimension)


def _function(one: Entry) -> str:
    slots = list(_slots(one))
    lines = [f"extern int32_t {one.name}(int64_t *table);", "", f"{_prototype(one)} {{"]
    lines.append(f"    int64_t table[{len(slots) + len(one.returns)}] = {{")
    lines += [f"        {slot}," for slot in slots]
    lines += ["    };", f"    int32_t failed = {one.name}(table);"]
    for i, leaf in enumerate(one.returns):
        number = f"table[{len(slots) + i}]"
        value = {"f": f"kinseek_number({number})", "i": number, "b": f"{number} != 0"}[leaf.element]
        lines.append(f"    *{_result(one, i)} = {value};")
    return "\n".join([*lines, "    return failed;", "}"])
