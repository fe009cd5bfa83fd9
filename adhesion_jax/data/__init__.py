"""Measured records: their columns, reading them, and the sets that ship with the package."""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from adhesion_jax.data.reading import Measured as Measured
from adhesion_jax.data.reading import check_curve as check_curve
from adhesion_jax.data.reading import read_all as read_all
from adhesion_jax.data.reading import read_measured as read_measured
from adhesion_jax.data.reading import to_measured as to_measured
from adhesion_jax.data.reading import to_record as to_record
from adhesion_jax.data.runs import RunSet as RunSet
from adhesion_jax.data.runs import as_one as as_one
from adhesion_jax.data.runs import matching as matching
from adhesion_jax.data.runs import read_runs as read_runs
from adhesion_jax.data.runs import to_runs as to_runs


class Shipped(NamedTuple):
    """A data set that comes with the package, and who is to be cited for it."""

    path: Path
    citation: str


#: Command-line name to data set.
SHIPPED: Mapping[str, Shipped] = {
    "eurosprinter": Shipped(
        Path(__file__).with_name("eurosprinter_127001.csv"),
        "Siemens locomotive Eurosprinter 127 001 in the field, 36 km/h, 106.7 kN a wheel, tangent "
        "track: Engel, Beck and Alders, Elektrische Bahnen 96 (1998) 201-209. 163 marker positions "
        "read from the figures doc/fig/eurosprinter5.jpg and eurosprinter6.jpg of the repository "
        "eve70a/CONTACT (Apache-2.0); reading error about .03 % creep and .001 in adhesion.",
    ),
    "roller-rig": Shipped(
        Path(__file__).with_name("vtfra_angle_of_attack.csv"),
        "Quarter-scale roller rig at Virginia Tech, one slip value, angle of attack from -1 to 1 "
        "degree: S. M. Hosseini, MS thesis, Virginia Tech (2020). 40 bin means read from the "
        "scatter plots of the repository mohammad-hosseini-s/Statistical-Modeling-of-Wheel-Rail-"
        "Contact-Using-Experimental-Data; the load of 9600 N and the longitudinal creep of 2 % "
        "are inferred, and the noise of single points does not show in the means.",
    ),
}
