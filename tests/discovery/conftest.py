import pytest

from adhesion_jax.discovery.model.program import fit

_PROGRAMS: dict = {}


@pytest.fixture(scope="module", autouse=True)
def fits_on_level_1():
    """Fits run longer than they compile, and on the level 0 of other tests half as long again.

    Elsewhere they are compiled as in the processes that tests start, to have the same bits.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(fit.options, "xla_backend_optimization_level", "1")
        patch.setattr(fit, "programs", _PROGRAMS)
        yield
