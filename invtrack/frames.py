"""Tables for pandas, which is loaded only when one is asked for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invtrack.errors import InvtrackError


def data_frame(columns: Mapping[str, ArrayLike], *, index: ArrayLike, index_name: str) -> Any:
    """A pandas.DataFrame of columns (m,) by name over an index (m,). Raises InvtrackError where pandas is not installed."""
    try:
        import pandas
    except ImportError as error:
        raise InvtrackError("a DataFrame needs pandas, which is not installed: pip install pandas") from error
    labels = pandas.Index(np.asarray(index), name=index_name)
    return pandas.DataFrame(dict(columns), index=labels)
