"""What arrays of one number, of the parameters of a problem and of pairs of them are called."""

from jaxtyping import Array, Bool, Float, Int

Value = Float[Array, ""]
Whether = Bool[Array, ""]
Count = Int[Array, ""]
Vector = Float[Array, " p"]
Matrix = Float[Array, "p p"]
