"""The report of a traction system: its table, its figures and the page that shows both."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import pandas as pd

from adhesion_jax.report.page import CAPTIONS
from adhesion_jax.report.traction import systems
from adhesion_jax.report.traction.panels import Panel
from adhesion_jax.report.traction.runs import Shown
from adhesion_jax.traction.plants.base import Plant


class Subject(NamedTuple):
    """The table and the figures of one system."""

    table: Callable[[pd.DataFrame], pd.DataFrame]
    figures: Callable[[Sequence[Shown], Plant], Mapping[str, Sequence[Panel]]]
    captions: Mapping[str, str]  # of each figure


SUBJECTS: Mapping[str, Subject] = {
    "uyulan2018": Subject(
        systems.uyulan2018_table, systems.uyulan2018_figures, CAPTIONS["uyulan2018"]
    ),
    "fang2018": Subject(systems.fang2018_table, systems.fang2018_figures, CAPTIONS["fang2018"]),
    "hxd1f": Subject(systems.hxd1f_table, systems.hxd1f_figures, CAPTIONS["hxd1f"]),
}
