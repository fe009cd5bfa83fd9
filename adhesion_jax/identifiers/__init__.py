"""From records to estimates. A new method is one file here and one line in IDENTIFIERS."""

from collections.abc import Mapping

from adhesion_jax.identifiers.bank_kiencke import bank_kiencke
from adhesion_jax.identifiers.base import Estimate as Estimate
from adhesion_jax.identifiers.base import Identifier as Identifier
from adhesion_jax.identifiers.base import Status as Status
from adhesion_jax.identifiers.base import follow as follow
from adhesion_jax.identifiers.base import identify as identify
from adhesion_jax.identifiers.bayes_departure import bayes_departure
from adhesion_jax.identifiers.gradient import GradientLeastSquares
from adhesion_jax.identifiers.imm_rails import imm_rails
from adhesion_jax.identifiers.kalman import ekf, ukf
from adhesion_jax.identifiers.kiencke_free import kiencke_free
from adhesion_jax.identifiers.ls_kiencke import (
    LinearLeastSquares,
    rls_kiencke,
    rls_kiencke_variable,
)
from adhesion_jax.identifiers.ml_de import ml_de, ml_de_eq16, ml_de_eq17, ml_de_he2018, ml_de_robust
from adhesion_jax.identifiers.ml_exact import ExactMaximumLikelihood, PooledMaximumLikelihood
from adhesion_jax.identifiers.particle import particle
from adhesion_jax.identifiers.qp_qian2024 import (
    qp_bias_compensated,
    qp_qian2024_1,
    qp_qian2024_2,
)
from adhesion_jax.identifiers.riv import riv
from adhesion_jax.identifiers.rls_slope import rls_slope
from adhesion_jax.identifiers.varpro_forgetting import (
    varpro_forgetting,
    varpro_forgetting_offset,
)
from adhesion_jax.optim import levenberg_marquardt, libraries

IDENTIFIERS: Mapping[str, Identifier] = {
    "ml-exact": ExactMaximumLikelihood(),
    "ml-pooled": PooledMaximumLikelihood(),
    "ml-de": ml_de,
    "ml-de-eq16": ml_de_eq16,
    "ml-de-eq17": ml_de_eq17,
    "ml-de-he2018": ml_de_he2018,
    "ml-de-robust": ml_de_robust,
    "lm": GradientLeastSquares(levenberg_marquardt.fit, steps=50),
    "lm-jaxopt": GradientLeastSquares(libraries.jaxopt_levenberg_marquardt, steps=50),
    "gn-jaxopt": GradientLeastSquares(libraries.jaxopt_gauss_newton, steps=20),
    "lm-optimistix": GradientLeastSquares(libraries.optimistix_levenberg_marquardt, steps=50),
    "gn-optimistix": GradientLeastSquares(libraries.optimistix_gauss_newton, steps=20),
    "bayes-departure": bayes_departure,
    "ls-kiencke": LinearLeastSquares(),
    "qp-qian2024-1": qp_qian2024_1,
    "qp-qian2024-2": qp_qian2024_2,
    "qp-bias-compensated": qp_bias_compensated,
    "rls-kiencke": rls_kiencke,
    "rls-kiencke-variable": rls_kiencke_variable,
    "riv": riv,
    "bank-kiencke": bank_kiencke,
    "kiencke-free": kiencke_free,
    "ekf": ekf,
    "ukf": ukf,
    "particle": particle,
    "imm-rails": imm_rails,
    "varpro-forgetting": varpro_forgetting,
    "varpro-forgetting-offset": varpro_forgetting_offset,
    "rls-slope": rls_slope,
}

#: Variants that explain a published method, solvers that find what `lm-jaxopt` and `gn-optimistix`
#: find, and what takes as long as all others together; they run only when named.
ABLATIONS = (
    "ml-de-eq16",
    "ml-de-eq17",
    "gn-jaxopt",
    "lm-optimistix",
    "bayes-departure",
    "varpro-forgetting",
    "varpro-forgetting-offset",
    "particle",
)
