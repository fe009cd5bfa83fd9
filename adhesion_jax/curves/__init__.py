"""Adhesion laws mu(slip). A new curve is one file here and one line in CURVES."""

from collections import ChainMap
from collections.abc import Mapping, MutableMapping

from adhesion_jax.curves.base import NO_CONDITIONS as NO_CONDITIONS
from adhesion_jax.curves.base import SLIP_LIMIT as SLIP_LIMIT
from adhesion_jax.curves.base import Conditions as Conditions
from adhesion_jax.curves.base import Curve as Curve
from adhesion_jax.curves.base import Law as Law
from adhesion_jax.curves.base import Parameter as Parameter
from adhesion_jax.curves.base import Scalar as Scalar
from adhesion_jax.curves.base import Signal as Signal
from adhesion_jax.curves.base import adhesion_of as adhesion_of
from adhesion_jax.curves.base import content_hash as content_hash
from adhesion_jax.curves.base import free_values as free_values
from adhesion_jax.curves.base import physical_box as physical_box
from adhesion_jax.curves.base import with_free_values as with_free_values
from adhesion_jax.curves.burckhardt import Burckhardt
from adhesion_jax.curves.exponential import Exponential
from adhesion_jax.curves.kiencke import Kiencke
from adhesion_jax.curves.level import Level
from adhesion_jax.curves.magic_formula import MagicFormula
from adhesion_jax.curves.peak import Peak as Peak
from adhesion_jax.curves.polach import Polach, PolachFalling, PolachScaled

#: The curves by their command-line names, with typical values and every parameter that measured
#: data can determine set free. One of your own is used from the moment when it is put here.
CURVES: MutableMapping[str, Curve] = {
    "burckhardt": Burckhardt(c1=0.3, c2=100.0, c3=0.3),
    "kiencke": Kiencke(a0=40.0, p1=100.0, p2=500.0, free=("a0", "p1", "p2")),
    "polach": Polach(mu0=0.3, stiffness=100.0),
    "polach-falling": PolachFalling(mu0=0.4, a=0.4, b=0.6, stiffness=150.0, k_s=0.4),
    "exponential": Exponential(a=1.0, b=100.0, c=0.3),
    "magic-formula": MagicFormula(b=100.0, c=1.5, d=0.3, e=0.0),
}

#: The curves that a law with effects may rest on; the level is for data at one slip.
BASES: Mapping[str, Curve] = ChainMap(
    {
        "polach-scaled": PolachScaled(mu0=0.4, a=0.4, b=0.6, stiffness=150.0, k_s=0.4),
        "level": Level(level=0.3),
    },
    CURVES,  # whose names come first
)
