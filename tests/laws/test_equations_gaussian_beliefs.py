"""Every labelled equation of the chapter on Gaussian beliefs, checked from its statement, by its name."""

import numpy as np
import sympy as sp
from scipy import integrate, stats
from worlds import random_covariance

from pendulab import Gaussian, discretize, gaussian, kalman, sensors, stream, systems

RNG = "tests/gaussian beliefs/"


def blocks(name, n=3, m=2):
    """A joint covariance of n and m numbers, whole and in blocks."""
    P = random_covariance(stream(RNG + name), n + m)
    return P, P[:n, :n], P[:n, n:], P[n:, n:]


def test_eq_gaussian_density():
    """The printed form against SciPy's density, and the package's function against the printed form."""
    rng = stream(RNG + "density")
    mean, P, x = rng.standard_normal(3), random_covariance(rng, 3), rng.standard_normal((5, 3))
    form = np.array([d @ np.linalg.inv(P) @ d for d in x - mean])
    printed = -0.5 * (form + np.log(np.linalg.det(P)) + 3 * np.log(2 * np.pi))
    np.testing.assert_allclose(printed, stats.multivariate_normal(mean, P).logpdf(x), rtol=1e-12)
    np.testing.assert_allclose(gaussian.log_density(x - mean, P), printed, rtol=1e-12)


def test_eq_ellipse():
    """The form in coordinates along the eigenvectors, and points at r √λ on the axes have the form r²."""
    rng = stream(RNG + "ellipse")
    P, d, r = random_covariance(rng, 3), rng.standard_normal(3), 1.7
    values, vectors = np.linalg.eigh(P)
    a = vectors.T @ d
    assert np.isclose(d @ np.linalg.solve(P, d), np.sum(a**2 / values), rtol=1e-12)
    for value, v in zip(values, vectors.T, strict=True):
        tip = r * np.sqrt(value) * v
        assert np.isclose(tip @ np.linalg.solve(P, tip), r**2, rtol=1e-12)


def test_eq_ellipse_share():
    """Both lines by integrals over spheres, and by SciPy."""
    r, s = sp.symbols("r s", positive=True)
    for n, printed in ((2, 1 - sp.exp(-(r**2) / 2)), (4, 1 - (1 + r**2 / 2) * sp.exp(-(r**2) / 2))):
        surface = 2 * sp.pi ** sp.Rational(n, 2) / sp.gamma(sp.Rational(n, 2))
        shells = sp.integrate(surface * s ** (n - 1) * sp.exp(-(s**2) / 2), (s, 0, r)) / (2 * sp.pi) ** (
            n // 2
        )
        assert sp.simplify(shells - printed) == 0
        assert np.isclose(float(printed.subs(r, 2)), stats.chi2.cdf(4, n), rtol=1e-12)


def test_eq_shadow():
    """The largest value of a·d over many points of the ellipse is the printed one."""
    rng = stream(RNG + "shadow")
    P, a, r = random_covariance(rng, 2), rng.standard_normal(2), 2.0
    turn = np.linspace(0, 2 * np.pi, 100_001)
    d = r * np.stack([np.cos(turn), np.sin(turn)], axis=-1) @ np.linalg.cholesky(P).T
    np.testing.assert_allclose(np.einsum("ki,ij,kj->k", d, np.linalg.inv(P), d), r**2, rtol=1e-9)
    assert np.isclose((d @ a).max(), r * np.sqrt(a @ P @ a), rtol=1e-8)
    draws = Gaussian(np.zeros(2), P).sample(rng, 200_000) @ a
    assert np.isclose(draws.var(), a @ P @ a, rtol=0.02)


def test_eq_linear_map():
    """Exactly, on a finite set of points with equal weights: its mean and covariance after the map."""
    rng = stream(RNG + "map")
    points, F, b = rng.standard_normal((6, 3)), rng.standard_normal((2, 3)), rng.standard_normal(2)
    mapped = np.array([F @ point + b for point in points])
    P = np.cov(points.T, bias=True)
    np.testing.assert_allclose(mapped.mean(axis=0), F @ points.mean(axis=0) + b, rtol=1e-12)
    np.testing.assert_allclose(np.cov(mapped.T, bias=True), F @ P @ F.T, rtol=1e-12)


def test_eq_swing():
    """F solves the linear equation, the printed covariance is the corner of F P Fᵀ; the package agrees."""
    t, Omega, st, sw = sp.symbols("t Omega sigma_theta sigma_omega", positive=True)
    F = sp.Matrix(
        [[sp.cos(Omega * t), sp.sin(Omega * t) / Omega], [-Omega * sp.sin(Omega * t), sp.cos(Omega * t)]]
    )
    A = sp.Matrix([[0, 1], [-(Omega**2), 0]])
    assert sp.simplify(F.diff(t) - A * F) == sp.zeros(2, 2)
    assert F.subs(t, 0) == sp.eye(2)
    corner = (F * sp.diag(st**2, sw**2) * F.T)[0, 1]
    printed = sp.sin(2 * Omega * t) * (sw**2 / Omega - Omega * st**2) / 2
    assert sp.simplify(corner - printed) == 0
    pendulum = systems.simple_pendulum(length=0.7)
    model = discretize(systems.linearised_about(pendulum, [0.0, 0.0]), 0.23, "exact")
    numbers = {t: 0.23, Omega: np.sqrt(9.81 / 0.7)}
    np.testing.assert_allclose(model.F, np.array(F.subs(numbers), dtype=float), rtol=1e-12)


def test_eq_block_factor():
    P, Pxx, Pxz, Pzz = blocks("factor")
    K = Pxz @ np.linalg.inv(Pzz)
    C, I3, I2, Z = Pxx - K @ Pxz.T, np.eye(3), np.eye(2), np.zeros((3, 2))
    upper, middle = np.block([[I3, K], [Z.T, I2]]), np.block([[C, Z], [Z.T, Pzz]])
    np.testing.assert_allclose(upper @ middle @ upper.T, P, rtol=1e-12, atol=1e-14)


def test_eq_completed_square():
    P, Pxx, Pxz, Pzz = blocks("square")
    dx, dz = np.split(stream(RNG + "square d").standard_normal(5), [3])
    K = Pxz @ np.linalg.inv(Pzz)
    C, d = Pxx - K @ Pxz.T, np.concatenate([dx, dz])
    whole = d @ np.linalg.solve(P, d)
    left = dx - K @ dz
    assert np.isclose(whole, left @ np.linalg.solve(C, left) + dz @ np.linalg.solve(Pzz, dz), rtol=1e-12)
    assert np.isclose(np.linalg.det(P), np.linalg.det(C) * np.linalg.det(Pzz), rtol=1e-12)


def test_eq_conditional():
    """By integration: mean and variance of p(x, z) over x, for one z, without the formula."""
    mean, P, z = np.array([0.3, -0.5]), np.array([[0.8, -0.6], [-0.6, 1.1]]), 0.7
    density = stats.multivariate_normal(mean, P)
    moment = [
        integrate.quad(lambda x, k=k: x**k * density.pdf([x, z]), -12, 12, epsabs=1e-13)[0] for k in range(3)
    ]
    after = mean[0] + P[0, 1] / P[1, 1] * (z - mean[1])
    assert np.isclose(moment[1] / moment[0], after, rtol=1e-9)
    assert np.isclose(moment[2] / moment[0] - after**2, P[0, 0] - P[0, 1] ** 2 / P[1, 1], rtol=1e-8)
    # And in blocks: the inverse of a block of the precision, as the whole density says it.
    P, Pxx, Pxz, Pzz = blocks("conditional")
    np.testing.assert_allclose(
        Pxx - Pxz @ np.linalg.solve(Pzz, Pxz.T), np.linalg.inv(np.linalg.inv(P)[:3, :3]), rtol=1e-10
    )


def test_eq_measurement_joint():
    """The joint covariance of x and H x + v is that of a linear map of (x, v); `update` conditions it."""
    rng = stream(RNG + "joint")
    P, R, H = random_covariance(rng, 3), random_covariance(rng, 2), rng.standard_normal((2, 3))
    mean, z = rng.standard_normal(3), rng.standard_normal(2)
    A = np.block([[np.eye(3), np.zeros((3, 2))], [H, np.eye(2)]])
    joint = A @ np.block([[P, np.zeros((3, 2))], [np.zeros((2, 3)), R]]) @ A.T
    np.testing.assert_allclose(joint[:3, 3:], P @ H.T, rtol=1e-12)
    np.testing.assert_allclose(joint[3:, 3:], H @ P @ H.T + R, rtol=1e-12)
    found = kalman.update(Gaussian(mean, P), z, sensors.linear(H, R)).posterior
    K = joint[:3, 3:] @ np.linalg.inv(joint[3:, 3:])
    np.testing.assert_allclose(found.mean, mean + K @ (z - H @ mean), rtol=1e-10)
    np.testing.assert_allclose(found.cov, P - K @ joint[3:, :3], rtol=1e-9, atol=1e-12)


def test_eq_one_look():
    P, R, z = np.array([[0.04, 0.03], [0.03, 0.09]]), 0.01, 0.5
    belief = Gaussian([0.2, -0.4], P)
    sensor = sensors.components(systems.simple_pendulum(), ["theta"], R)
    found = kalman.update(belief, [z], sensor).posterior
    assert np.isclose(found.mean[1], -0.4 + 0.03 / (0.04 + R) * (z - 0.2), rtol=1e-12)
    assert np.isclose(found.cov[1, 1], 0.09 - 0.03**2 / (0.04 + R), rtol=1e-12)


def test_eq_fusion():
    """The sum of two log-densities, by finite differences: where its slope vanishes and how it curves."""
    rng = stream(RNG + "fusion")
    (P1, P2), (x1, x2) = (random_covariance(rng, 2) for _ in range(2)), rng.standard_normal((2, 2))
    precision = np.linalg.inv(P1) + np.linalg.inv(P2)
    mean = np.linalg.solve(precision, np.linalg.inv(P1) @ x1 + np.linalg.inv(P2) @ x2)

    def log(x):
        return sum(stats.multivariate_normal(m, P).logpdf(x) for m, P in ((x1, P1), (x2, P2)))

    E = 1e-3 * np.eye(2)
    slope = np.array([log(mean + e) - log(mean - e) for e in E]) / 2e-3
    np.testing.assert_allclose(slope, 0, atol=1e-9)
    curve = [
        [(log(mean + a + b) - log(mean + a - b) - log(mean - a + b) + log(mean - a - b)) / 4e-6 for a in E]
        for b in E
    ]
    np.testing.assert_allclose(-np.array(curve), precision, rtol=1e-6)


def test_eq_weighted_least_squares():
    """No other unbiased linear combination has a smaller variance, and its covariance is the printed one."""
    rng = stream(RNG + "weighted")
    H, R = rng.standard_normal((4, 2)), random_covariance(rng, 4)
    P = np.linalg.inv(H.T @ np.linalg.inv(R) @ H)
    W = P @ H.T @ np.linalg.inv(R)
    np.testing.assert_allclose(W @ H, np.eye(2), atol=1e-12)
    np.testing.assert_allclose(W @ R @ W.T, P, rtol=1e-10)
    hidden = np.linalg.svd(H.T)[2][2:]  # rows that H does not touch
    for _ in range(20):
        other = W + rng.standard_normal((2, 2)) @ hidden
        np.testing.assert_allclose(other @ H, np.eye(2), atol=1e-10)
        assert np.linalg.eigvalsh(other @ R @ other.T - P)[0] > -1e-10


def two_cameras():
    s1, s2, rho = sp.symbols("sigma1 sigma2 rho", positive=True)
    s12 = rho * s1 * s2
    return s1, s2, rho, s12, sp.Matrix([[s1**2, s12], [s12, s2**2]])


def test_eq_two_cameras():
    s1, s2, _, s12, R = two_cameras()
    H = sp.ones(2, 1)
    P = (H.T * R.inv() * H).inv()
    w = sp.simplify(P * H.T * R.inv())
    total = s1**2 + s2**2 - 2 * s12
    assert sp.simplify(w[0] - (s2**2 - s12) / total) == 0
    assert sp.simplify(w[0] + w[1] - 1) == 0
    assert sp.simplify(P[0] - (s1**2 * s2**2 - s12**2) / total) == 0


def naive(s1, s2, R):
    w = sp.Matrix([[s2**2, s1**2]]) / (s1**2 + s2**2)
    return sp.simplify((w * R * w.T)[0])


def test_eq_naive_fusion():
    s1, s2, _, s12, R = two_cameras()
    claimed = 1 / (1 / s1**2 + 1 / s2**2)
    assert sp.simplify(claimed - s1**2 * s2**2 / (s1**2 + s2**2)) == 0
    assert sp.simplify(naive(s1, s2, R) - claimed * (1 + 2 * s12 / (s1**2 + s2**2))) == 0


def test_eq_second_camera_harms():
    s1, s2, rho, _, R = two_cameras()
    limit = s1 * (s1**2 + s2**2) / (2 * s2**3)
    assert sp.simplify(sp.solve(naive(s1, s2, R) - s1**2, rho)[0] - limit) == 0
    beyond = naive(s1, s2, R).subs({s1: 1, s2: 2})
    assert limit.subs({s1: 1, s2: 2}) == sp.Rational(5, 16)
    assert beyond.subs(rho, sp.Rational(1, 3)) > 1 > beyond.subs(rho, sp.Rational(1, 4))


def test_eq_mean_on_arc():
    mean, std = 0.7, 0.6
    for curve, printed in ((np.sin, np.sin(mean)), (lambda a: -np.cos(a), -np.cos(mean))):
        value = integrate.quad(lambda a, f=curve: f(a) * stats.norm.pdf(a, mean, std), -6, 8)[0]
        assert np.isclose(value, np.exp(-(std**2) / 2) * printed, rtol=1e-9)


def test_eq_variance_of_combination():
    """On a finite set of points: the variance of a combination is aᵀ P a."""
    rng = stream(RNG + "combination")
    points, a = rng.standard_normal((9, 4)), rng.standard_normal(4)
    assert np.isclose((points @ a).var(), a @ np.cov(points.T, bias=True) @ a, rtol=1e-12)


def test_eq_cholesky_two():
    s1, s2, rho, s12, P = two_cameras()
    G = sp.Matrix([[s1, 0], [rho * s2, s2 * sp.sqrt(1 - rho**2)]])
    assert sp.simplify(G * G.T - P) == sp.zeros(2, 2)
    assert sp.simplify(G[1, 1] ** 2 - (s2**2 - s12**2 / s1**2)) == 0  # the conditional variance
    numbers = {s1: 0.3, s2: 2.0, rho: -0.4}
    np.testing.assert_allclose(
        np.linalg.cholesky(np.array(P.subs(numbers), dtype=float)), np.array(G.subs(numbers), dtype=float)
    )
