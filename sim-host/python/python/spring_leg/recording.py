"""Recordings of `sim-host run --record` as columns."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, Literal, overload

import numpy.typing as npt

from spring_leg._leg import read_columns

if TYPE_CHECKING:
    import pandas

Columns = dict[str, npt.NDArray[Any]]


@overload
def read_recording(path: str | os.PathLike[str]) -> dict[str, Columns]: ...
@overload
def read_recording(
    path: str | os.PathLike[str], *, pandas: Literal[False]
) -> dict[str, Columns]: ...
@overload
def read_recording(
    path: str | os.PathLike[str], *, pandas: Literal[True]
) -> dict[str, pandas.DataFrame]: ...
def read_recording(path: str | os.PathLike[str], *, pandas: bool = False) -> Any:
    """Returns a recording: for each topic that it has, such as `/state`, its columns.

    A column is an array with the values of one field, a message each; `leg.proto` describes the
    fields and their units. Those of readings of raw sensors are named `sensors.…`. With
    `pandas=True` each topic is a DataFrame. A file that was cut off is read as far as it goes,
    with a warning.
    """
    topics = read_columns(path)
    if not pandas:
        return topics
    from pandas import DataFrame

    return {topic: DataFrame(columns) for topic, columns in topics.items()}
