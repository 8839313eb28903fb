"""Equations of the second chapter on the report on the double pendulum."""

import numpy as np
import pytest
import sympy as sp

from pendulab import sigma_points
from pendulab.replications import muzaffari2024_aukf as aukf

K, d, R, e, C, P = sp.symbols("K d R e C P", positive=True)


def test_eq_straying():
    limit = (1 - K) / K * d
    assert sp.simplify((1 - K) * (limit + d) - limit) == 0
    assert aukf.straying(0.3) == pytest.approx(float(limit.subs({K: 0.3, d: 1})))


def test_eq_gain_noise():
    limit = K / (2 - K) * R
    assert sp.simplify((1 - K) ** 2 * limit + K**2 * R - limit) == 0
    golden = (sp.sqrt(5) - 1) / 2
    assert sp.simplify(limit.subs({K: golden, R: 1}) - 1 / sp.sqrt(5)) == 0


def test_eq_golden():
    prior = (1 + sp.sqrt(5)) / 2 * C
    gain = prior / (prior + C)
    assert sp.simplify((1 - gain) * prior + C - prior) == 0
    assert sp.simplify(gain - (sp.sqrt(5) - 1) / 2) == 0
    assert aukf.steady_gain(7.0, 7.0) == pytest.approx(float(gain))


@pytest.mark.parametrize("alpha", [1.0, 0.1, 1e-3])
def test_eq_weights_cancel(alpha):
    wm, _ = sigma_points.scaled(alpha).weights(4)
    assert np.abs(wm).sum() == pytest.approx(2 / alpha**2 - 1)
    assert wm[0] == pytest.approx(1 - 1 / alpha**2) and wm[1] == pytest.approx(1 / (8 * alpha**2))
