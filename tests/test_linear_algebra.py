"""Eigenvalues are found where LAPACK's divide and conquer gives up."""

import numpy as np
import pytest

from adhesion_jax.linear_algebra import eigh


@pytest.fixture
def giving_up(monkeypatch):
    def never(_):
        raise np.linalg.LinAlgError("Eigenvalues did not converge")

    monkeypatch.setattr(np.linalg, "eigh", never)


def symmetric(*shape):
    drawn = np.random.default_rng(4).standard_normal((*shape, shape[-1]))
    return drawn + np.swapaxes(drawn, -1, -2)


@pytest.mark.usefixtures("giving_up")
@pytest.mark.parametrize("shape", [(5,), (3, 4), (2, 3, 6)])
def test_another_method_finds_the_same_where_the_first_does_not_converge(shape):
    matrices = symmetric(*shape)
    values, vectors = eigh(matrices)
    assert values.shape == shape
    assert (np.diff(values) >= 0).all()
    again = vectors * values[..., None, :] @ np.swapaxes(vectors, -1, -2)
    np.testing.assert_allclose(again, matrices, atol=1e-12)
    square = np.swapaxes(vectors, -1, -2) @ vectors
    np.testing.assert_allclose(square, np.broadcast_to(np.eye(shape[-1]), square.shape), atol=1e-12)


def test_of_known_eigenvalues_both_find_them(request):
    # [[2, 1], [1, 2]] has 1 and 3, along (1, -1) and (1, 1).
    matrix = np.array([[2.0, 1.0], [1.0, 2.0]])
    for _ in range(2):
        values, vectors = eigh(matrix)
        np.testing.assert_allclose(values, [1.0, 3.0])
        np.testing.assert_allclose(np.abs(vectors), np.full((2, 2), 0.5**0.5))
        request.getfixturevalue("giving_up")


@pytest.mark.usefixtures("giving_up")
def test_numbers_that_are_not_finite_are_refused():
    with pytest.raises(np.linalg.LinAlgError):
        eigh(np.full((2, 2), np.nan))
