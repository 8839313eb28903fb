"""Every labelled equation of the chapter on likelihood and variational Bayes, checked from its statement."""

import numpy as np
import pytest
import sympy as sp
from scipy import integrate, stats
from scipy.linalg import solve_discrete_are

from pendulab import Gaussian, LinearModel, adaptive, kalman, sensors, stream, track

F = np.array([[0.9, 0.3], [-0.2, 0.8]])
MODEL = LinearModel(F)
H = np.array([[1.0, 0.0], [0.4, 1.0]])
Q0, R0 = np.array([[0.3, 0.1], [0.1, 0.2]]), np.array([[0.5, -0.1], [-0.1, 0.4]])
START = Gaussian([0.2, -0.1], 0.7)
Z = stream("tests/variational").standard_normal((12, 2))
STEP = 1e-5


def filtered(theta, scaled_start=False):
    """A track whose Q and R carry the factors e^ϑ."""
    q, r = np.exp(theta)
    start = Gaussian(START.mean, q * START.cov) if scaled_start else START
    return track(start, MODEL, sensors.linear(H, r * R0), Z, q * Q0, method=kalman)


def difference(of, i, at=(0.2, -0.3), **options):
    move = STEP * np.eye(2)[i]
    return (of(filtered(at + move, **options)) - of(filtered(at - move, **options))) / (2 * STEP)


AT = np.array([0.2, -0.3])


def test_eq_likelihood_score():
    """½ yᵀS⁻¹SᵢS⁻¹y − ½ tr S⁻¹Sᵢ − yᵢᵀS⁻¹y is the derivative of the package's log-likelihood."""
    seen = filtered(AT)
    for i in range(2):
        y_i, S_i = difference(lambda t: t.innovation, i), difference(lambda t: t.innovation_cov, i)
        for k in range(len(Z)):
            y, S = seen.innovation[k], np.linalg.inv(seen.innovation_cov[k])
            score = (y @ S @ S_i[k] @ S @ y - np.trace(S @ S_i[k])) / 2 - y_i[k] @ S @ y
            assert score == pytest.approx(difference(lambda t: t.log_likelihood, i)[k], rel=1e-5, abs=1e-7)


def test_eq_filter_sensitivities():
    """The differentiated recursion, against differences of the package's filter."""
    seen = filtered(AT)
    q, r = np.exp(AT)
    for i in range(2):
        Q_i, R_i = (q * Q0, 0 * R0) if i == 0 else (0 * Q0, r * R0)
        x_i, P_i = np.zeros(2), np.zeros((2, 2))
        found = {
            name: difference(lambda t, name=name: getattr(t, name), i)
            for name in ("predicted_mean", "predicted_cov", "innovation", "innovation_cov", "mean", "cov")
        }
        for k in range(len(Z)):
            x_i, P_i = F @ x_i, F @ P_i @ F.T + Q_i
            S = seen.innovation_cov[k]
            y_i, S_i = -H @ x_i, H @ P_i @ H.T + R_i
            K = seen.predicted_cov[k] @ H.T @ np.linalg.inv(S)
            K_i, I_KH = (P_i @ H.T - K @ S_i) @ np.linalg.inv(S), np.eye(2) - K @ H
            own = {"predicted_mean": x_i, "predicted_cov": P_i, "innovation": y_i, "innovation_cov": S_i}
            x_i = x_i + K_i @ seen.innovation[k] + K @ y_i
            P_i = I_KH @ P_i @ I_KH.T + K @ R_i @ K.T
            own |= {"mean": x_i, "cov": P_i}
            for name, value in own.items():
                np.testing.assert_allclose(value, found[name][k], atol=1e-8)


def test_eq_likelihood_information():
    """Mean of the product of two scores given the past, by Gauss and Hermite in two dimensions."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(6)
    weights = weights / weights.sum()
    rng = stream("tests/variational/information")
    S = np.array([[2.0, 0.5], [0.5, 1.0]])
    y_is = rng.standard_normal((2, 2))
    S_is = [a + a.T for a in rng.standard_normal((2, 2, 2))]
    inverse, factor = np.linalg.inv(S), np.linalg.cholesky(S)

    def score(y, i):
        quadratic = y @ inverse @ S_is[i] @ inverse @ y - np.trace(inverse @ S_is[i])
        return quadratic / 2 - y_is[i] @ inverse @ y

    product = 0.0
    for a, wa in zip(nodes, weights, strict=True):
        for b, wb in zip(nodes, weights, strict=True):
            y = factor @ [a, b]
            product += wa * wb * score(y, 0) * score(y, 1)
    expected = np.trace(inverse @ S_is[0] @ inverse @ S_is[1]) / 2 + y_is[0] @ inverse @ y_is[1]
    assert product == pytest.approx(expected, rel=1e-10)


def test_eq_scale_information():
    """Along the common scale S_i sums to S and y_i to zero, so every frame adds m/2."""
    seen = filtered(AT)
    move = STEP * np.ones(2)
    ahead, behind = (filtered(AT + s * move, scaled_start=True) for s in (1, -1))
    seen = filtered(AT, scaled_start=True)
    S_sum = (ahead.innovation_cov - behind.innovation_cov) / (2 * STEP)
    np.testing.assert_allclose(S_sum, seen.innovation_cov, rtol=1e-8)
    np.testing.assert_allclose(ahead.innovation, behind.innovation, atol=1e-12)
    ratio = np.linalg.solve(seen.innovation_cov, S_sum)
    added = np.trace(ratio @ ratio, axis1=1, axis2=2).sum() / 2
    assert added == pytest.approx(len(Z) * 2 / 2)


P_MINUS, NU, V, Y = 1.5, 5.0, 4.0, 2.0


def log_joint(x, R):
    return (
        stats.norm.logpdf(Y, x, np.sqrt(R))
        + stats.norm.logpdf(x, 0, np.sqrt(P_MINUS))
        + stats.invgamma.logpdf(R, NU / 2, scale=V / 2)
    )


def bound(mean, var, nu, scale):
    """𝓕 of q(x) = N(mean, var) and q(R) inverse gamma, by sums over a grid."""
    x = mean + np.sqrt(var) * np.linspace(-7, 7, 141)
    R = np.exp(np.linspace(-5, 8, 401))
    q_x = stats.norm.pdf(x, mean, np.sqrt(var)) * (x[1] - x[0])
    q_R = stats.invgamma.pdf(R, nu / 2, scale=scale / 2) * R * np.log(R[1] / R[0])
    log_q = stats.norm.logpdf(x, mean, np.sqrt(var))[:, None] + stats.invgamma.logpdf(
        R, nu / 2, scale=scale / 2
    )
    inside = log_joint(x[:, None], R) - log_q
    return np.sum(q_x[:, None] * q_R * inside)


def fixed_point():
    R = V / NU
    for _ in range(200):
        K = P_MINUS / (P_MINUS + R)
        R = (V + ((1 - K) * Y) ** 2 + (1 - K) * P_MINUS) / (NU + 1)
    return K * Y, (1 - K) * P_MINUS, NU + 1, (NU + 1) * R


def test_eq_evidence_bound():
    """ln p(z) = 𝓕 + divergence, for a q that is not the best one."""
    evidence = integrate.quad(
        lambda u: np.exp(
            stats.norm.logpdf(Y, 0, np.sqrt(P_MINUS + np.exp(u)))
            + stats.invgamma.logpdf(np.exp(u), NU / 2, scale=V / 2)
            + u
        ),
        -12,
        12,
    )[0]
    q = (0.7, 0.6, 6.0, 5.0)
    x, R = np.linspace(-6, 8, 701), np.exp(np.linspace(-5, 8, 1301))
    weight = (x[1] - x[0]) * np.log(R[1] / R[0]) * R
    log_q = stats.norm.logpdf(x, q[0], np.sqrt(q[1]))[:, None] + stats.invgamma.logpdf(
        R, q[2] / 2, scale=q[3] / 2
    )
    log_posterior = log_joint(x[:, None], R) - np.log(evidence)
    divergence = np.sum(weight * np.exp(log_q) * (log_q - log_posterior))
    assert divergence > 0.05
    assert bound(*q) + divergence == pytest.approx(np.log(evidence), abs=1e-4)


def best_by_search(of, start):
    from scipy.optimize import minimize

    return minimize(lambda v: -of(v), start, method="Nelder-Mead", options=dict(xatol=1e-5, fatol=1e-10)).x


def test_eq_vb_state():
    """With q(R) held, 𝓕 is highest for the Kalman update with R̂ = 𝓥/ν = 1/E(1/R)."""
    nu, scale = 6.0, 7.0
    found = best_by_search(lambda v: bound(v[0], np.exp(v[1]), nu, scale), [0.5, 0.0])
    K = P_MINUS / (P_MINUS + scale / nu)
    assert found[0] == pytest.approx(K * Y, abs=1e-3)
    assert np.exp(found[1]) == pytest.approx((1 - K) * P_MINUS, rel=1e-3)
    draws = stats.invgamma(nu / 2, scale=scale / 2)
    assert draws.expect(lambda R: 1 / R) == pytest.approx(nu / scale, rel=1e-6)


def test_eq_vb_noise():
    """With q(x) held, 𝓕 is highest for ν + 1 and 𝓥 + ε² + P; and the package takes these numbers."""
    mean, var = 0.8, 0.5
    found = best_by_search(lambda v: bound(mean, var, np.exp(v[0]), np.exp(v[1])), [1.7, 1.5])
    np.testing.assert_allclose(np.exp(found), [NU + 1, V + (Y - mean) ** 2 + var], rtol=2e-3)
    scheme = adaptive.variational_R(kalman, forgetting=1.0, confidence=NU, sweeps=200)
    still = LinearModel([[1.0]])
    eye = sensors.linear([[1.0]], V / NU)
    seen = track(Gaussian([0.0], P_MINUS), still, eye, [[Y], [np.nan]], 0.0, method=scheme)
    x, P, nu, scale = fixed_point()
    assert seen.R[1, 0, 0] == pytest.approx(scale / nu)
    assert seen.mean[0, 0] == pytest.approx(x)
    assert seen.cov[0, 0, 0] == pytest.approx(P)


def test_eq_vb_memory():
    """ν = φν + 1 has the solution 1/(1 − φ), and there R̂ fades as stated, in the package too."""
    phi, nu = sp.symbols("phi nu")
    assert (
        sp.solve(sp.Eq(nu, phi * nu + 1), nu) == [1 / (1 - phi)]
        or sp.simplify(sp.solve(sp.Eq(nu, phi * nu + 1), nu)[0] - 1 / (1 - phi)) == 0
    )
    scheme = adaptive.variational_R(kalman, forgetting=0.9, confidence=10.0, sweeps=1)
    seen = track(START, MODEL, sensors.linear(H, R0), Z, Q0, method=scheme)
    for k in range(len(Z) - 1):
        left = Z[k] - H @ seen.mean[k]
        term = np.outer(left, left) + H @ seen.cov[k] @ H.T
        np.testing.assert_allclose(seen.R[k + 1], 0.9 * seen.R[k] + 0.1 * term, rtol=1e-10)


def test_eq_vb_fixed_point():
    """Mean of ε² + HPHᵀ less R, with the gain of one component: ς²(C − S)."""
    p, R, C = sp.symbols("p R C", positive=True)
    S = p + R
    share, K = R / S, p / S
    residual = (1 - K) ** 2 * C
    posterior = (1 - K) * p
    assert sp.simplify(residual + posterior - R - share**2 * (C - S)) == 0
    assert sp.simplify(posterior - share * (S - R)) == 0


def settled(R, q=0.4):
    model, eye = np.array([[1.0, 0.3], [-0.3, 0.9]]), np.array([[1.0, 0.0]])
    P = solve_discrete_are(model.T, eye.T, q * np.diag([0.02, 1.0]), [[R]])
    return P[0, 0] + R


def test_eq_vb_rate():
    """d/dR of ς²C + ς(S − R) at C = S is 1 − ς²S′, for any S(R); with a frozen prediction S′ = 1."""
    R, C = sp.symbols("R C", positive=True)
    S = sp.Function("S")(R)
    term = (R / S) ** 2 * C + (R / S) * (S - R)
    slope = sp.diff(term, R).subs(C, S)
    assert sp.simplify(slope - (1 - (R / S) ** 2 * sp.diff(S, R))) == 0
    for value in (0.1, 1.0, 10.0):
        assert (settled(1.01 * value) - settled(value)) / (0.01 * value) >= 1


def test_eq_vb_power():
    """The product of 1 − a/(ν₀ + k) approaches the power, and the exponent exactly."""
    a, first = 0.3, 50.0
    k = np.arange(1, 20001)
    left = np.cumprod(1 - a / (first + k))
    np.testing.assert_allclose(left, (first / (first + k)) ** a, rtol=0.01)
    assert np.log(left[9999] / left[19999]) / np.log(2) == pytest.approx(a, rel=0.01)


def test_eq_vb_calm():
    """A recursion with pull a/ν and push 2ς⁴S²/ν² settles at 1/(νS′) of R², for large ν."""
    nu, R, S, slope = 200.0, 0.3, 2.0, 1.7
    share = R / S
    a = share**2 * slope
    var = 2 * share**4 * S**2 / nu**2 / (1 - (1 - a / nu) ** 2)  # where var is its own successor
    assert var / R**2 == pytest.approx(1 / (nu * slope), rel=0.01)


def test_eq_student_predictive():
    """The mean of Gaussians over an inverse gamma is Student's t with scale √R̂."""
    nu, R_hat = 5.0, 0.7
    for y in (0.0, 1.0, 4.0):
        mean = integrate.quad(
            lambda u, y=y: (
                stats.norm.pdf(y, 0, np.exp(u / 2))
                * stats.invgamma.pdf(np.exp(u), nu / 2, scale=nu * R_hat / 2)
                * np.exp(u)
            ),
            -15,
            15,
        )[0]
        assert mean == pytest.approx(stats.t.pdf(y, nu, scale=np.sqrt(R_hat)), rel=1e-6)
        ratio = (1 + y**2 / (nu * R_hat)) ** (-(nu + 1) / 2)
        assert mean / stats.t.pdf(0, nu, scale=np.sqrt(R_hat)) == pytest.approx(ratio, rel=1e-6)
