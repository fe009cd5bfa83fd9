"""How a model predicts one run: in stages, from the slip to the adhesion."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from adhesion_jax.curves import BASES, Conditions, Curve, with_free_values
from adhesion_jax.curves.bent import BELOW_EFFECTS, functions
from adhesion_jax.discovery.model.packing import Model, layout, words_of
from adhesion_jax.effects import KINDS
from adhesion_jax.effects.shape import ACTS_ON, fallen

#: Numbers that are added on the way from the parameters to the adhesion, by their place: to the
#: departure at the slip of a point and at that of the peak, to the slip, and to each of the sums
#: that the terms of the shape make. A model has zeros there; derivatives by them are wanted.
AT_SLIP, AT_PEAK, OF_SLIP, OF_SUMS = 0, 1, 2, 3
ADDED = OF_SUMS + len(ACTS_ON)


class Stages(NamedTuple):
    """How a model predicts one run, in stages; together they are equal to `law.with_effects`.

    All but `at` are functions of the values of the model first.
    """

    used: Array  # the number of slots up to the last effect: empty ones take no time
    acts: Array  # whether any cause acts on the adhesion
    term: Callable[[Array, Array], Array]  # g of the term of the shape in a slot, else 0
    sums: Callable[[Array], Array]  # of the terms, by what they act on
    bent: Callable[[Array], Array]  # the slip after the causes that bend it
    at: Callable[[Array, Array], Array]  # that at which the curve is evaluated, of bent and sums
    contact: Callable[[Array, Array, Array, Array], Array]  # adhesion, of bent, sums, what is added
    caused: Callable[[Array, Array], Array]  # the adhesion after the causes that act on it


def stages_of(
    model: Model, span: Array, slip: Array, conditions: Conditions, columns: Array, peak: Array
) -> Stages:
    """The stages of a model for one run.

    `slip`, `conditions` and `columns` are those of its points, and `peak` is the slip of the
    curve's peak at each; `span` is the reach of the departure and the largest slip of all points.
    """
    kind, places = model.kind, layout()
    slots, nothing = jnp.arange(kind.size), jnp.zeros_like(slip)

    def acting(
        names: Sequence[str], acts: Callable[[Any, Conditions, Array], Array]
    ) -> tuple[Callable[[Array, Array, Array], Array], Array, Array]:
        """What the effect in a slot makes of a value, if it is one of these; else the value.

        And the first and the end of the slots with such an effect.
        """
        which = places.branches(names)[kind]

        def act(values: Array, slot: Array, value: Array) -> Array:
            own = values[places.base : -1].reshape(kind.size, places.effect)[slot]

            def branch(name: str) -> Callable[[Array], Array]:
                def act(value: Array) -> Array:
                    named = KINDS[name]
                    numbers = {key: own[place] for place, key in enumerate(named.FACTS.parameters)}
                    words = dict(zip(words_of(named), ("first", "second"), strict=False))
                    effect: Any = named(**numbers, **words)
                    first, second = (columns[model.column[slot, place]] for place in (0, 1))
                    return acts(effect, {**conditions, "first": first, "second": second}, value)

                return act

            return jax.lax.switch(which[slot], [lambda value: value, *map(branch, names)], value)

        first = jnp.min(jnp.where(which > 0, slots, kind.size))
        return act, first, jnp.max(jnp.where(which > 0, slots + 1, 0))

    shape, _, _ = acting(places.shapes, lambda one, seen, to: to + one.log_factor(seen))
    bend, first_bend, end_bend = acting(places.bending, lambda one, seen, x: one.before(x, seen))
    cause, first_cause, end_cause = acting(
        places.causes, lambda one, seen, mu: one.after(mu, slip, seen)
    )
    used = jnp.max(jnp.where(kind > 0, slots + 1, 0))

    def term(values: Array, slot: Array) -> Array:
        # A constant has no shape of its own.
        return shape(values, slot, nothing)

    def sums(values: Array) -> Array:
        def add(slot: Array, sums: Array) -> Array:
            return sums.at[model.column[slot, 2]].add(term(values, slot))

        return jax.lax.fori_loop(0, used, add, jnp.zeros((len(ACTS_ON), slip.size)))

    def bent(values: Array) -> Array:
        def before(turn: Array, bent: Array) -> Array:
            return bend(values, end_bend - 1 - turn, bent)

        return jax.lax.fori_loop(0, end_bend - first_bend, before, slip)

    def at(bent: Array, sums: Array) -> Array:
        return bent * jnp.exp(sums[ACTS_ON.index("slip")]) + sums[ACTS_ON.index("shift")]

    def contact(values: Array, bent: Array, sums: Array, added: Array) -> Array:
        sums = sums + added[OF_SUMS:, None]
        level, _, fall, offset, _ = sums
        place = at(bent + added[OF_SLIP], sums)

        def curve(place: Array, more: Array) -> Array:
            return curve_of(model._replace(values=values), span, place, conditions, more)

        adhesion = jax.lax.cond(
            falls(model),
            lambda adhesion: fallen(
                lambda slip: curve(slip, added[AT_PEAK]), place, adhesion, fall, peak
            ),
            lambda plain: plain,
            curve(place, added[AT_SLIP]),
        )
        return adhesion * jnp.exp(level) + offset

    def caused(values: Array, adhesion: Array) -> Array:
        return jax.lax.fori_loop(first_cause, end_cause, partial(cause, values), adhesion)

    return Stages(used, end_cause > first_cause, term, sums, bent, at, contact, caused)


def curve_of(
    model: Model, span: Array, slip: Array, conditions: Conditions, more: Array | float = 0.0
) -> Array:
    """The prediction of the curve without effects, for each point; `slip` may be one for all.

    `more` is added to its departure.
    """
    departure = _departures(slip, factors_of(model.values), span)
    bend = departure[..., 0] + jnp.where(slip < 0, departure[..., 1], 0.0)
    return straight_of(model, slip, conditions) * (1 + bend + more)


def straight_of(model: Model, slip: Array, conditions: Conditions) -> Array:
    """The prediction of the curve without effects and without its departure."""
    shape = jnp.broadcast_shapes(slip.shape, *map(jnp.shape, conditions.values()))

    def branch(curve: Curve) -> Callable[[Array], Array]:
        return lambda slip: with_free_values(curve, model.values[: len(curve.free)])(
            jnp.broadcast_to(slip, shape), conditions
        )

    return jax.lax.switch(model.base, [branch(curve) for curve in BASES.values()], slip)


def factors_of(values: Array) -> Float[Array, "two functions"]:
    return values[layout().curve : layout().base].reshape(2, BELOW_EFFECTS)


@jax.custom_jvp
def _departures(
    slip: Float[Array, "*shape"], factors: Float[Array, "two functions"], span: Float[Array, " two"]
) -> Float[Array, "*shape two"]:
    """The departure, and what braking adds to it."""
    return functions(slip, span[0], span[1], BELOW_EFFECTS) @ factors.T


@_departures.defjvp
def _(
    primals: tuple[Array, Array, Array], tangents: tuple[Array, Array, Array]
) -> tuple[Array, Array]:
    """With the slopes over slip summed before they meet a tangent.

    A tangent of the slip has then one product a point and not one for each function, which took
    four fifths of the time of a fit.
    """
    slip, factors, span = primals
    along, of_factors, _ = tangents
    shape, slopes = jax.jvp(
        lambda slip: functions(slip, span[0], span[1], BELOW_EFFECTS),
        (slip,),
        (jnp.ones_like(slip),),
    )
    change = (slopes @ factors.T) * along[..., None] + shape @ of_factors.T
    return shape @ factors.T, change


def falls(models: Model) -> Bool[Array, ""]:
    """Whether a term acts on the fall of the curve, of one model or of any of several."""
    return jnp.any((models.kind > 0) & (models.column[..., 2] == ACTS_ON.index("fall")))
