"""How lines are told apart, in colour and in grey."""

#: Okabe and Ito's colours, which the colour-blind can tell apart, in an order of falling darkness.
_COLOURS = ("#000000", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#7F7F7F")
_DASHES = ("-", "--", "-.", ":", (0, (5, 1)), (0, (3, 1, 1, 1)), (0, (1, 1)), (0, (8, 3)))
_MARKERS = ("o", "s", "^", "D", "v", "x", "+", "*")


def line_styles(names: list[str]) -> dict[str, dict[str, object]]:
    """A colour, a dash and a marker for each name.

    A colour comes back with the next dash: no two of the first 64 share both.
    """
    count = len(_COLOURS)
    return {
        name: {
            "color": _COLOURS[i % count],
            "linestyle": _DASHES[(i + i // count) % count],
            "marker": _MARKERS[(i + i // count) % count],
        }
        for i, name in enumerate(names)
    }
