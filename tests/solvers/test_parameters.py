"""Parameters of searches that are out of range or of another kind: refused when the search is made, with what is valid."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek.errors import InvalidSolver

WRONG: dict[Any, list[tuple[dict[str, Any], str]]] = {
    kinseek.Atlas: [
        ({"samples": 1}, "samples must be"),
        ({"samples": 2**30}, "samples must be"),
        ({"threads": 0}, "threads must be"),
    ],
    kinseek.BlindSearch: [
        ({"step": 0.0}, "step must be"),
        ({"step": np.nan}, "step must be"),
        ({"step": np.inf}, "step must be"),
        ({"shrink": 1.0}, "shrink must be"),
        ({"smallest_step": 0.0}, "smallest_step must be"),
        ({"most_steps": 0}, "most_steps must be"),
    ],
    kinseek.BruteForce: [
        ({"branching_factor": 0}, "branching_factor must be a whole number of at least 1, got 0"),
        ({"stop_below": -1.0}, "stop_below must be a number >= 0, got -1.0"),
        ({"stop_below": float("nan")}, "stop_below must be a number >= 0, got nan"),
        ({"stop_below": "0.1"}, "stop_below must be a number >= 0, got '0.1'"),
        ({"stop_below": None}, "stop_below must be a number >= 0, got None"),
        ({"stop_below": 10**400}, "stop_below must be a number >= 0, got 1000"),
        ({"order": "backwards"}, "order must be one of paper, low-discrepancy, random; got 'backwards'"),
    ],
    kinseek.CoordinateDescent: [
        ({"most_sweeps": 0}, "most_sweeps must be"),
        ({"stall": 1.0}, "stall must be"),
        ({"stall": -0.1}, "stall must be"),
    ],
    kinseek.DivideAndConquer: [
        ({"branching_factor": 0}, "branching_factor must be a whole number of at least 1, got 0"),
        ({"branching_factor": 2**62 + 1}, "branching_factor"),
        ({"divisions": 1}, "divisions must be a whole number of at least 2, got 1"),
        ({"breadth": 0}, "breadth must be a number from 1 to 1,000,000, got 0"),
        ({"breadth": 0.5}, "breadth must be a number from 1 to 1,000,000, got 0.5"),
        ({"breadth": True}, "breadth must be a number from 1 to 1,000,000, got True"),
        ({"breadth": 10**400}, "breadth must be a number from 1 to 1,000,000, got 1"),
        ({"breadth": (2, np.nan)}, "every breadth must be a number from 1 to 1,000,000, got nan"),
        ({"breadth": np.inf}, "breadth must be a number from 1 to 1,000,000, got inf"),
        ({"breadth": (1, 0)}, "every breadth must be a number from 1"),
        ({"breadth": "wide"}, "'reach' or 'tuned'; got 'wide'"),
        ({"beam": 10**12}, "beam must be a whole number from 1 to 1,000,000"),
        ({"beam": 0}, "beam must be a whole number from 1"),
        ({"children": 0}, "children must be a whole number of at least 1"),
        ({"node_budget": 0}, "node_budget must be a whole number of at least 1"),
        ({"tree": "both"}, "tree must be 'static' or 'dynamic', got 'both'"),
        ({"wrap": None}, "wrap must be True or False, got None"),
        ({"wrap": 0}, "wrap must be True or False, got 0"),
        ({"first": "both"}, "first must be 'D' or 'formula', got 'both'"),
        ({"limited": "ends"}, "limited must be 'middles' or 'letter', got 'ends'"),
        ({"offset": 1.0}, "offset must be at least 0 and below 1, in cells of the first pass; got 1.0"),
        ({"offset": -0.1}, "offset must be"),
        ({"offset": (0.0, np.nan)}, "got nan"),
        ({"offset": "half"}, "got 'half'"),
        ({"offset": True}, "got True"),
        ({"offset": 10**400}, "offset must be at least 0 and below 1, in cells of the first pass; got 1000"),
        ({"stop_below": -1.0}, "stop_below must be a number >= 0, got -1.0"),
        ({"ties": "last"}, "ties must be one of 'rounding', 'first'; got 'last'"),
        ({"ties": "first", "beam": 2}, "got beam=2"),
    ],
    kinseek.SeparateChains: [
        ({"divisions": 1}, "divisions must be a whole number of at least 2"),
        *(
            ({"again": wrong}, "again must be a distance in metres of at least 0, got")
            for wrong in (-1.0, float("nan"), "far", None, True)
        ),
    ],
}


@pytest.mark.parametrize(
    ("search", "options", "words"),
    [(search, *case) for search, cases in WRONG.items() for case in cases],
    ids=lambda value: getattr(value, "__name__", None),
)
def test_what_is_no_parameter_is_refused(search: Any, options: dict[str, Any], words: str) -> None:
    with pytest.raises(InvalidSolver) as refused:
        search(**options)
    assert words in str(refused.value)
