"""The probability of a failure at a margin, and the estimated number of failures among undriven episodes.

A Bayesian logistic regression on the margin, with a bend at zero, fitted to episodes that the driving system drove
after the surrogate had been trained. The posterior is drawn from by importance sampling around its mode with a
multivariate t (Gelman et al., Bayesian Data Analysis, 3rd ed., sections 10.4 and 13.2). It rests on this: the odds of a
failure fall smoothly as the margin grows. Failures that no margin foretells, at a constant small rate, would be missed
by it; a share of the episodes is therefore drawn at random, and `docs/search.md` says how often the intervals cover.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import expit

Floats = NDArray[np.float64]


_LOW, _HIGH = -0.5, 3.0  # [m] or [s]: margins beyond these are all alike
_MEAN, _DEVIATION = np.array([-1.0, -6.0, 2.0, -1.0]), np.array([3.0, 4.0, 6.0, 3.0])  # of the normal prior
_FREEDOM = 6  # of the t distribution that is drawn from
_DRAWS = 4000
_CELLS = 400  # classes of margins over which the rest is summed


class Count(NamedTuple):
    """Number and share of failures in a pool, each as an estimate with a 95% interval."""

    failures: float
    failures_low: float
    failures_high: float
    rate: float
    rate_low: float
    rate_high: float


class Risk:
    """The probability of a failure at each margin.

    :param margin: float64[n] [m] or [s]; failed: bool[n]. Without any, what holds is the prior.
    """

    def __init__(self, margin: Floats, failed: NDArray[np.bool_]) -> None:
        self._x, self._y = _terms(margin), failed.astype(np.float64)
        found = minimize(self._loss, _MEAN, jac=True, method="BFGS")
        self._mode: Floats = found.x
        chance = expit(self._x @ self._mode)
        information = (self._x * (chance * (1.0 - chance))[:, None]).T @ self._x + np.diag(_DEVIATION**-2.0)
        self._spread = np.linalg.cholesky(np.linalg.inv(information))

    def chance(self, margin: Floats) -> Floats:
        """Return the estimated probability of a failure at each margin, float64[n]."""
        chance: Floats = expit(_terms(margin) @ self._mode)
        return chance

    def count(self, known: int, driven: int, margin: Floats, rng: np.random.Generator) -> Count:
        """Return the estimated number of failures in a pool of which a part was driven.

        :param known: failures among the `driven` episodes.
        :param margin: float64[m], of the rest.
        """
        coefficients = self._draws(rng)
        cells = np.array_split(np.sort(margin), min(_CELLS, max(1, len(margin))))
        terms = np.stack([_terms(cell).mean(axis=0) if len(cell) else _terms(np.array([_HIGH]))[0] for cell in cells])
        sizes = np.array([len(cell) for cell in cells], np.float64)
        failures = known + rng.poisson(sizes @ expit(terms @ coefficients.T))
        rate = rng.gamma(failures + 0.5) / (driven + len(margin))  # Jeffreys' prior of a rate
        bounds = [*np.quantile(failures, [0.025, 0.975]), float(rate.mean()), *np.quantile(rate, [0.025, 0.975])]
        return Count(float(failures.mean()), *(float(bound) for bound in bounds))

    def _loss(self, coefficients: Floats) -> tuple[float, Floats]:
        """Return minus the log of the posterior density, and its gradient."""
        logit = self._x @ coefficients
        away = (coefficients - _MEAN) / _DEVIATION
        value = np.sum(np.logaddexp(0.0, logit) - self._y * logit) + 0.5 * away @ away
        return float(value), self._x.T @ (expit(logit) - self._y) + away / _DEVIATION

    def _draws(self, rng: np.random.Generator) -> Floats:
        """Return draws of the coefficients from the posterior, float64[d, 4]."""
        normal = rng.standard_normal((_DRAWS, len(self._mode)))
        scaled = normal * np.sqrt(_FREEDOM / rng.chisquare(_FREEDOM, (_DRAWS, 1)))
        found = self._mode + scaled @ self._spread.T
        square = (scaled**2).sum(axis=1)
        proposed = -0.5 * (_FREEDOM + len(self._mode)) * np.log1p(square / _FREEDOM)
        logit = self._x @ found.T
        away = (found - _MEAN) / _DEVIATION
        density = (self._y[:, None] * logit - np.logaddexp(0.0, logit)).sum(axis=0) - 0.5 * (away**2).sum(axis=1)
        weight = density - proposed
        weight = np.exp(weight - weight.max())
        draws: Floats = found[rng.choice(_DRAWS, _DRAWS // 2, p=weight / weight.sum())]
        return draws


def _terms(margin: Floats) -> Floats:
    """Return the terms of the logit, float64[n, 4]."""
    x = np.clip(margin, _LOW, _HIGH)
    return np.stack([np.ones_like(x), x, np.minimum(x, 0.0), np.sqrt(np.maximum(x, 0.0))], axis=1)
