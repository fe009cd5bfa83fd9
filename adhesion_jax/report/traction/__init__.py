"""The report of a traction system: its table, its figures and the page that shows both."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import pandas as pd

from adhesion_jax.report.page import CAPTIONS
from adhesion_jax.report.traction import fang2018, hxd1f, uyulan2018
from adhesion_jax.report.traction.panels import Panel
from adhesion_jax.report.traction.runs import Drawing


class Subject(NamedTuple):
    """The table and the figures of one system."""

    table: Callable[[pd.DataFrame], pd.DataFrame]
    figures: Callable[[Drawing], Mapping[str, Sequence[Panel]]]
    captions: Mapping[str, str]  # of each figure


SUBJECTS: Mapping[str, Subject] = {
    "uyulan2018": Subject(uyulan2018.table, uyulan2018.figures, CAPTIONS["uyulan2018"]),
    "fang2018": Subject(fang2018.table, fang2018.figures, CAPTIONS["fang2018"]),
    "hxd1f": Subject(hxd1f.table, hxd1f.figures, CAPTIONS["hxd1f"]),
}
