"""Every labelled equation of the chapter on sigma points, checked from its statement, by name."""

import numpy as np
import pytest
import sympy as sp
from worlds import random_covariance

from pendulab import FilterDiverged, Gaussian, discretize, sigma_points, stream, systems, ukf
from pendulab.sensors.protocol import Sensor

RNG = "tests/sigma points/"
PARAMETERS = [(1.0, 2.0, 0.0), (0.5, 0.0, 1.0), (0.1, 3.0, -1.0), (1.0, 0.0, -1.0)]
each_set = pytest.mark.parametrize("parameters", PARAMETERS, ids=str)


def symbols_of(n):
    """α, β, κ, s², W, W0 and Wc0 for n states, and a quadratic function with slopes a and bends B."""
    alpha, beta, kappa = sp.symbols("alpha beta kappa", positive=True)
    s2 = alpha**2 * (n + kappa)
    W, W0 = 1 / (2 * s2), 1 - n / s2
    a = sp.Matrix(sp.symbols(f"a1:{n + 1}"))
    B = sp.Matrix(n, n, lambda i, j: sp.Symbol(f"B{min(i, j)}{max(i, j)}"))
    return alpha, beta, kappa, s2, W, W0, W0 + 1 - alpha**2 + beta, a, B


def quadratic_by_points(n):
    alpha, beta, kappa, s2, W, _W0, Wc0, a, B = symbols_of(n)
    axes = [sign * sp.sqrt(s2) * sp.eye(n)[:, j] for j in range(n) for sign in (1, -1)]
    values = [(a.T * x)[0] + (x.T * B * x)[0] / 2 for x in axes]
    mean = W * sum(values)
    variance = Wc0 * mean**2 + W * sum((v - mean) ** 2 for v in values)
    return sp.simplify(mean), variance, (alpha, beta, kappa, s2, a, B)


def expectation(expression, xi):
    """The mean over independent standard normal symbols of a polynomial of degree up to six in each."""
    moment = {0: 1, 1: 0, 2: 1, 3: 0, 4: 3, 5: 0, 6: 15}
    terms = sp.Poly(sp.expand(expression), *xi).terms()
    return sum(c * sp.prod([moment[p] for p in powers]) for powers, c in terms)


@each_set
@pytest.mark.parametrize("n", [2, 3, 5])
def test_eq_sigma_weights(parameters, n):
    points = sigma_points.scaled(*parameters)
    (wm, _), offsets = points.weights(n), points.offsets(n)
    s2 = offsets[1, 0] ** 2
    assert s2 == pytest.approx(parameters[0] ** 2 * (n + parameters[2]))
    np.testing.assert_allclose(wm[1:], 1 / (2 * s2), rtol=1e-13)
    assert wm[0] == pytest.approx(1 - n / s2, rel=1e-12)
    np.testing.assert_allclose(np.einsum("k,ki,kj->ij", wm, offsets, offsets), np.eye(n), atol=1e-12)


@each_set
def test_eq_sigma_fourth(parameters):
    points = sigma_points.scaled(*parameters)
    (wm, _), xi = points.weights(3), points.offsets(3)
    s2 = xi[1, 0] ** 2
    np.testing.assert_allclose(wm @ xi**4, s2, rtol=1e-12)
    assert wm @ (xi[:, 0] ** 2 * xi[:, 1] ** 2) == 0


def step_of_arms():
    model = discretize(systems.double_pendulum(), 0.1)
    rng = stream(RNG + "arms")
    return model, Gaussian([1.5, 0.0, 1.0, 0.5], 0.1 * random_covariance(rng, 4))


def parts(f, belief, points):
    n, values = belief.n, f(points.points(belief))
    columns = points.offsets(n)[1, 0] * np.linalg.cholesky(belief.cov)
    plus, minus = (np.array([f(belief.mean + sign * c) for c in columns.T]) for sign in (1, -1))
    return values, plus, minus, points.offsets(n)[1, 0] ** 2


@each_set
def test_eq_odd_even(parameters):
    """The values at the points are f0 + ψ ± o."""
    if 4 + parameters[2] <= 0:
        pytest.skip("no such set")
    model, belief = step_of_arms()
    values, plus, minus, _ = parts(model.step, belief, sigma_points.scaled(*parameters))
    odd, even = (plus - minus) / 2, (plus + minus) / 2 - values[0]
    np.testing.assert_allclose(values[1:5], values[0] + even + odd, atol=1e-13)
    np.testing.assert_allclose(values[5:], values[0] + even - odd, atol=1e-13)


@each_set
def test_eq_ut_mean(parameters):
    model, belief = step_of_arms()
    points = sigma_points.scaled(*parameters)
    values, plus, minus, s2 = parts(model.step, belief, points)
    b = ((plus + minus) / 2 - values[0]).sum(axis=0) / s2
    found = ukf.predict(belief, model, 0.0, points=points).mean
    np.testing.assert_allclose(found, values[0] + b, atol=1e-11)
    assert np.abs(b).max() > 1e-3


@each_set
def test_eq_ut_split(parameters):
    model, belief = step_of_arms()
    points = sigma_points.scaled(*parameters)
    values, plus, minus, s2 = parts(model.step, belief, points)
    odd, even = (plus - minus) / 2, (plus + minus) / 2 - values[0]
    b = even.sum(axis=0) / s2
    alpha, beta, _ = parameters
    printed = (odd.T @ odd + even.T @ even) / s2 + (beta - alpha**2) * np.outer(b, b)
    found = ukf.predict(belief, model, 0.0, points=points).cov
    np.testing.assert_allclose(found, printed, atol=1e-10)
    assert np.abs(even.T @ even / s2).max() > 1e-5


@each_set
def test_eq_weight_sum(parameters):
    alpha, beta, _kappa, _s2, W, _W0, Wc0, *_ = symbols_of(3)
    assert sp.simplify(Wc0 + 6 * W - (2 - alpha**2 + beta)) == 0
    _, wc = sigma_points.scaled(*parameters).weights(3)
    assert wc.sum() == pytest.approx(2 - parameters[0] ** 2 + parameters[1], abs=1e-12)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_eq_ut_quadratic(n):
    mean, variance, (alpha, beta, _kappa, s2, a, B) = quadratic_by_points(n)
    assert sp.simplify(mean - B.trace() / 2) == 0
    printed = (a.T * a)[0] + s2 / 4 * sum(B[j, j] ** 2 for j in range(n))
    printed += (beta - alpha**2) / 4 * B.trace() ** 2
    assert sp.simplify(variance - printed) == 0


def test_eq_quadratic_exact():
    *_, a, B = symbols_of(3)
    xi = sp.Matrix(sp.symbols("xi1:4"))
    f = (a.T * xi)[0] + (xi.T * B * xi)[0] / 2
    mean = expectation(f, xi)
    assert sp.simplify(mean - B.trace() / 2) == 0
    variance = expectation((f - mean) ** 2, xi)
    assert sp.simplify(variance - (a.T * a)[0] - (B * B).trace() / 2) == 0


def test_eq_beta_one():
    _, variance, (alpha, beta, kappa, _s2, a, B) = quadratic_by_points(1)
    truth = a[0] ** 2 + B[0, 0] ** 2 / 2
    assert sp.simplify((variance - truth).subs(beta, 2 - alpha**2 * kappa)) == 0
    assert sp.simplify((variance - truth).subs({beta: 2, kappa: 1})) != 0


@pytest.mark.parametrize("n", [1, 2, 4])
def test_eq_bowl(n):
    for alpha, beta, kappa in PARAMETERS:
        if n + kappa <= 0:
            continue
        points = sigma_points.scaled(alpha, beta, kappa)
        (wm, wc), values = points.weights(n), np.sum(points.offsets(n) ** 2, axis=-1) / 2
        variance = wc @ (values - wm @ values) ** 2
        assert variance / (n / 2) == pytest.approx((n * beta + alpha**2 * kappa) / 2, abs=1e-10)


class Bowl(Sensor):
    n, names, units, is_angle, R = 4, ("z",), ("1",), np.array([False]), np.array([[1e-6]])

    def h(self, x):
        return np.sum(np.asarray(x) ** 2, axis=-1, keepdims=True)


@pytest.mark.parametrize("beta", [0.0, 0.5])
def test_eq_ut_positive(beta):
    """On the edge the covariance is positive for random values at the points; beyond it a bowl fails."""
    n, alpha, rng = 4, 0.8, stream(RNG + "positive")
    edge = -n * beta / alpha**2
    if n + edge > 0:
        points = sigma_points.scaled(alpha, beta, edge)
        wm, wc = points.weights(n)
        for _ in range(200):
            values = rng.standard_normal((2 * n + 1, 3))
            d = values - wm @ values
            assert np.linalg.eigvalsh((d * wc[:, None]).T @ d)[0] > -1e-9
    belief = Gaussian(np.zeros(n), 1.0)
    assert np.isfinite(
        ukf.update(belief, [1.0], Bowl(), points=sigma_points.scaled(alpha, beta, edge + 0.01)).nis
    )
    with pytest.raises(FilterDiverged):
        ukf.update(belief, [1.0], Bowl(), points=sigma_points.scaled(alpha, beta, edge - 0.01))


def test_eq_ut_mean_error():
    """For a polynomial of fourth degree the error is the printed one, exactly."""
    n = 2
    _alpha, _beta, _kappa, s2, W, _W0, *_ = symbols_of(n)
    xi = sp.Matrix(sp.symbols("xi1:3"))
    c = sp.symbols("c0:5")
    f = sum(c[k] * xi[0] ** (4 - k) * xi[1] ** k for k in range(5))
    D = {"iiii": 24 * (c[0] + c[4]), "iijj": 2 * 4 * c[2]}  # both orders of i and j
    axes = [sign * sp.sqrt(s2) * sp.eye(n)[:, j] for j in range(n) for sign in (1, -1)]
    by_points = W * sum(f.subs(dict(zip(xi, x, strict=True)), simultaneous=True) for x in axes)
    printed = (s2 - 3) / 24 * D["iiii"] - D["iijj"] / 8
    assert sp.simplify(by_points - expectation(f, xi) - printed) == 0


def test_eq_alpha_limit():
    pendulum = systems.simple_pendulum()
    belief = Gaussian([1.0, 0.5], [[0.04, 0.02], [0.02, 0.09]])
    slope = np.array([9.81 * np.sin(1.0), 0.5])
    b = (9.81 * np.cos(1.0) * 0.04 + 0.09) / 2
    for beta in (0.0, 2.0):
        wm, wc = (points := sigma_points.scaled(1e-3, beta)).weights(2)
        values = pendulum.energy(points.points(belief))
        mean = wm @ values
        assert mean == pytest.approx(pendulum.energy(belief.mean) + b, abs=1e-6)
        assert wc @ (values - mean) ** 2 == pytest.approx(slope @ belief.cov @ slope + beta * b**2, abs=1e-5)


def test_eq_alpha_rounding():
    """The rounding of the values never moves the mean by more than printed, and often by a tenth of it."""
    rng, delta, n, kappa = stream(RNG + "rounding"), 2.0**-24, 3, 0.5
    for alpha in (0.1, 0.01):
        points = sigma_points.scaled(alpha, 2.0, kappa)
        wm, _ = points.weights(n)
        f = 5 + rng.random((400, 2 * n + 1))
        f[:, 0] = f[:, 0].astype(np.float32)  # the middle is counted by itself
        moved = np.abs((f.astype(np.float32).astype(float) - f) @ wm)
        bound = n / (n + kappa) * delta * 6 / alpha**2
        assert n / (n + kappa) / alpha**2 == pytest.approx(n / points.offsets(n)[1, 0] ** 2)
        assert 0.1 * bound < moved.max() < bound
