"""Results as pandas tables, where pandas is there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import MissingExtra

Array = NDArray[np.float64]


def frame(
    names: Sequence[str],
    q: Array,
    facts: Mapping[str, Any],
    index: Sequence[NDArray[Any]],
    levels: Sequence[str],
) -> Any:
    """A ``pandas.DataFrame``: a column for each joint, one for each fact, a row for each answer.

    Args:
        names: Of the joints.
        q: Joint values, (k, n).
        facts: Further columns, (k,) each. A joint that has such a name is called ``joint NAME``.
        index: what each row is called by, numbers (k,) for each level.
        levels: Names of the levels.

    Raises:
        MissingExtra: pandas is not installed.
    """
    try:
        import pandas as pd
    except ImportError as error:
        raise MissingExtra("to_frame", "frame") from error
    columns = {f"joint {name}" if name in facts else name: q[:, i] for i, name in enumerate(names)}
    rows = (
        pd.MultiIndex.from_arrays(index, names=levels) if len(index) > 1 else pd.Index(*index, name=levels[0])
    )
    return pd.DataFrame({**columns, **facts}, index=rows)
