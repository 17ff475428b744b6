"""What makes a picture hard to read, found on the figure itself: the test fails on what a reader would stumble over."""

from __future__ import annotations

from itertools import combinations
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from numpy.typing import NDArray

LEAST_TEXT = 8.5
"""Height of the smallest letters [px] when the picture is shown as wide as a page of text, 900 px."""
PAGE = 900.0
LEAST_MARKER = 4.0
"""Width of a marker of a legend [pt]."""


def faults(figure: Any) -> list[str]:
    """Everything that is wrong with a figure, one line each: covered, cut off, too small, or not to be seen."""
    from matplotlib.legend import Legend
    from matplotlib.text import Text

    drawn = _drawn_texts(figure)
    legends = figure.findobj(Legend)
    within = {id(text) for legend in legends for text in legend.findobj(Text)}
    boxes = [(f"legend {_first(legend)!r}", legend.get_window_extent()) for legend in legends]
    words = [(repr(text.get_text()), box) for text, box in drawn if id(text) not in within]
    return [
        *_overlaps(boxes + words),
        *_cut_off(figure, boxes + words),
        *(
            found
            for legend in legends
            for found in _over_data(figure, _first(legend), legend.get_window_extent())
        ),
        *(found for axes in figure.axes for text in axes.texts for found in _crossed(figure, text)),
        *(found for legend in legends for found in _pale(legend)),
        *_small(figure, [text for text, _ in drawn]),
        *_without_unit(figure),
    ]


def faults_of_saved(monkeypatch: pytest.MonkeyPatch, write: bool = False) -> list[str]:
    """The faults of every figure that is saved from now on, at the resolution that it is saved with; written or not."""
    from matplotlib.figure import Figure

    seen: list[str] = []

    def save(figure: Any, *given: Any, real: Any = Figure.savefig, **options: Any) -> None:
        figure.set_dpi(options.get("dpi") or figure.dpi)
        seen.extend(faults(figure))
        if write:  # As it is laid out already, and coarse: that a file is written is what counts.
            figure.set_layout_engine("none")
            real(figure, *given, **options | {"dpi": 20})

    monkeypatch.setattr(Figure, "savefig", save)
    return seen


def _drawn_texts(figure: Any) -> list[tuple[Any, Any]]:
    """Every text that drawing puts down, and its box [px]; ticks beyond the ends of an axis are not among them."""
    from matplotlib.text import Text

    drawn: dict[int, tuple[Any, Any]] = {}
    draw = Text.draw

    def noted(text: Any, renderer: Any, *args: Any, **options: Any) -> None:
        draw(text, renderer, *args, **options)
        if text.get_visible() and text.get_text().strip():
            drawn[id(text)] = text, text.get_window_extent(renderer)

    with patch.object(Text, "draw", noted):
        figure.canvas.draw()
    return list(drawn.values())


def _first(legend: Any) -> str:
    return str(legend.get_texts()[0].get_text())


def _inside(box: Any, pixels: float = 1.0) -> Any:
    """The box without its edge, so that what only touches it is no fault."""
    return box.padded(-min(pixels, box.width / 3, box.height / 3))


def _overlaps(boxes: list[tuple[str, Any]]) -> list[str]:
    return [
        f"{first} and {second} are printed over each other"
        for (first, one), (second, two) in combinations(boxes, 2)
        if _inside(one).overlaps(_inside(two))
    ]


def _cut_off(figure: Any, boxes: list[tuple[str, Any]]) -> list[str]:
    edge = figure.bbox
    return [
        f"{name} leaves the picture"
        for name, box in boxes
        if box.x0 < edge.x0 - 1 or box.y0 < edge.y0 - 1 or box.x1 > edge.x1 + 1 or box.y1 > edge.y1 + 1
    ]


def _over_data(figure: Any, name: str, box: Any) -> list[str]:
    """What lies under a legend."""
    found = []
    for axes in figure.axes:
        if hasattr(axes, "zaxis") or not axes.bbox.overlaps(box):
            continue
        for line in axes.lines:
            if line.get_path().transformed(line.get_transform()).intersects_bbox(box, filled=False):
                found.append(f"legend {name!r} lies over the line {line.get_label()!r}")
        for dots in axes.collections:
            places = dots.get_offset_transform().transform(np.ma.filled(dots.get_offsets(), np.nan))
            if len(places) and _any_within(places, box):
                found.append(f"legend {name!r} lies over dots")
        if any(patch.get_window_extent().overlaps(box) for patch in axes.patches):
            found.append(f"legend {name!r} lies over bars")
    return found


def _any_within(places: NDArray[np.float64], box: Any) -> bool:
    x, y = places.T
    return bool(((x > box.x0) & (x < box.x1) & (y > box.y0) & (y < box.y1)).any())


def _crossed(figure: Any, text: Any) -> list[str]:
    """Lines and markers under a text that stands among data."""
    box = _inside(text.get_window_extent(), 2.0)
    return [
        f"{text.get_text()!r} is crossed by the line {line.get_label()!r}"
        for line in text.axes.lines
        if line.get_path().transformed(line.get_transform()).intersects_bbox(box, filled=False)
    ]


def _pale(legend: Any) -> list[str]:
    """Entries whose marker is too small or too pale to be seen on white."""
    from matplotlib.collections import PathCollection
    from matplotlib.colors import to_rgba

    colour: Any
    found = []
    for handle, text in zip(legend.legend_handles, legend.get_texts(), strict=True):
        if isinstance(handle, PathCollection):
            size, colour = float(np.sqrt(handle.get_sizes()[0])), handle.get_facecolor()[0]
        elif getattr(handle, "get_marker", lambda: "None")() not in ("None", "", None):
            size, colour = float(handle.get_markersize()), to_rgba(handle.get_markerfacecolor())
        else:
            continue
        red, green, blue, alpha = colour
        grey = 1 - alpha * (1 - (0.2126 * red**2.2 + 0.7152 * green**2.2 + 0.0722 * blue**2.2))
        if size < LEAST_MARKER or 1.05 / (grey + 0.05) < 1.8:
            found.append(f"the marker of {text.get_text()!r} is hardly seen")
    return found


def _small(figure: Any, texts: list[Any]) -> list[str]:
    shown = PAGE / figure.get_figwidth() / 72
    return sorted(
        {
            f"letters of {text.get_text()!r} are {text.get_fontsize() * shown:.1f} px high on a page"
            for text in texts
            if text.get_fontsize() * shown < LEAST_TEXT
        }
    )


def _without_unit(figure: Any) -> list[str]:
    """Axes of space that lack a label."""
    found = []
    for axes in figure.axes:
        named = [axis for axis in ("x", "y", "z") if hasattr(axes, f"{axis}axis")]
        if "z" in named:
            found += [
                f"the {axis} axis has no label with a unit"
                for axis in named
                if not getattr(axes, f"get_{axis}label")().endswith("[m]")
            ]
    return found
