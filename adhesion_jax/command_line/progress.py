"""How long work shows what is being done, and the time that is left."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from tqdm import tqdm

_BAR = "{desc} {percentage:3.0f} %|{bar}| {elapsed}<{remaining}"


@contextmanager
def shown(words: str = "") -> Iterator[Callable[[str, float], None]]:
    """A function of words and the share that is done, which shows both while it is called.

    Nothing is shown where the standard error is not a terminal.
    """
    with tqdm(total=100, desc=words, bar_format=_BAR, leave=False, disable=None) as bar:

        def progress(words: str, share: float) -> None:
            bar.set_description_str(words)
            bar.update(100 * share - bar.n)

        yield progress
