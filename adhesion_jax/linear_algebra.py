"""Eigenvalues of symmetric matrices, also where the usual method does not converge."""

import numpy as np
import scipy


def eigh(matrices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues [..., n] and eigenvectors [..., n, n] of symmetric matrices [..., n, n].

    They are numpy's, by divide and conquer (LAPACK's syevd), which for rare ordinary matrices does
    not converge: then all are found by the slower QR iteration (syev).

    Raises LinAlgError if a matrix is not finite.
    """
    try:
        return np.linalg.eigh(matrices)
    except np.linalg.LinAlgError:
        if not np.isfinite(matrices).all():
            raise
    size = matrices.shape[-1]
    flat = [scipy.linalg.eigh(one, driver="ev") for one in matrices.reshape(-1, size, size)]
    values, vectors = (np.stack(found) for found in zip(*flat, strict=True))
    return values.reshape(matrices.shape[:-1]), vectors.reshape(matrices.shape)
