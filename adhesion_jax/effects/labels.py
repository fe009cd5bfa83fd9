"""A column of labels: names, or numbers that are names."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from adhesion_jax.effects.api import Columns, Conditions, Form, Scalar, Values
from adhesion_jax.effects.shape import ShapeTerm

#: Most labels of a column.
MOST = 12

#: The value of a label that the data lack.
NO_LABEL = 1e12


class Labels(ShapeTerm):
    """g = k_j where the column has the label j, 0 at any other value.

    Labels in words are numbers from 0 in the order of their names.
    """

    k1: Scalar
    k2: Scalar
    k3: Scalar
    k4: Scalar
    k5: Scalar
    k6: Scalar
    k7: Scalar
    k8: Scalar
    k9: Scalar
    k10: Scalar
    k11: Scalar
    k12: Scalar
    label1: Scalar
    label2: Scalar
    label3: Scalar
    label4: Scalar
    label5: Scalar
    label6: Scalar
    label7: Scalar
    label8: Scalar
    label9: Scalar
    label10: Scalar
    label11: Scalar
    label12: Scalar
    column: str = eqx.field(static=True)

    FACTS = Form(
        source="one level a label, shrunk towards that of all: Laird and Ware 1982, Biometrics "
        "38:963",
        described={
            **{
                f"k{j}": ("1", -50.0, 50.0, f"change of g at label {j}") for j in range(1, MOST + 1)
            },
            **{f"label{j}": ("column", -1e12, 1e12, f"label {j}") for j in range(1, MOST + 1)},
        },
        strengths=tuple(f"k{j}" for j in range(1, MOST + 1)),
        references={f"label{j}": "column" for j in range(1, MOST + 1)},
        formula="g = k_j where the column has the label j",
        phrase="a level of its own for each label of {}",
    )

    def log_factor(self, conditions: Conditions) -> Values:
        z = jnp.asarray(conditions[self.column])
        terms = [
            getattr(self, f"k{j}") * (z == getattr(self, f"label{j}")) for j in range(1, MOST + 1)
        ]
        return jnp.sum(jnp.stack(terms), axis=0)

    def values(self) -> list[float]:
        """The labels that the data have."""
        labels = (float(getattr(self, f"label{j}")) for j in range(1, MOST + 1))
        return [label for label in labels if label != NO_LABEL]

    @classmethod
    def at_places(cls) -> np.ndarray:
        return np.eye(MOST)

    @classmethod
    def starts(cls, columns: Columns) -> list[ShapeTerm]:
        """One for each column of labels."""
        found: list[ShapeTerm] = []
        for name, z in columns.items():
            names = labels_of(z)
            if len(names) > 1:
                numbers: dict[str, Any] = {
                    f"k{j}": 0.02 if j <= len(names) else 0.0 for j in range(1, MOST + 1)
                }
                padded = [*names, *[NO_LABEL] * (MOST - len(names))]
                numbers |= {f"label{j}": label for j, label in enumerate(padded, 1)}
                found.append(cls(**numbers, column=name))
        return found


def labels_of(values: np.ndarray) -> list[float]:
    """The whole numbers that a column consists of; none if there are too many or others."""
    some = np.unique(values[: 50 * MOST])
    if some.size > MOST or np.any(some != np.round(some)):
        return []
    names = np.unique(values[np.isfinite(values)])
    whole = names.size <= MOST and bool(np.all(names == np.round(names)))
    return names.tolist() if whole else []
