"""The laws once more, on worlds that nobody chose: hypothesis draws sizes, gaps, runs, units and physics.

Sizes and structure are drawn by hypothesis, so that a failure shrinks to the smallest system that shows it;
the numbers of a matrix come from a named stream, so that they are generic and well conditioned. The profile
is derandomised: the suite tries the same worlds on every machine.
"""

import tempfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, configuration, given, settings
from hypothesis import strategies as st
from worlds import random_covariance

from pendulab import (
    Gaussian,
    LinearModel,
    angles,
    cubature,
    discretize,
    ekf,
    iterated_ekf,
    kalman,
    sensors,
    sigma_points,
    simulate,
    square_root_ukf,
    stream,
    systems,
    track,
    ukf,
    white_acceleration,
)

configuration.set_hypothesis_home_dir(Path(tempfile.gettempdir()) / "pendulab-hypothesis")
laws = settings(
    derandomize=True,
    deadline=None,
    max_examples=25,
    print_blob=True,
    suppress_health_check=[HealthCheck.too_slow],
    phases=[Phase.explicit, Phase.generate, Phase.shrink],
)
few = settings(laws, max_examples=12)

FILTERS = {
    "ekf": ekf,
    "ukf": ukf,
    "iterated_ekf": iterated_ekf,
    "square_root_ukf": square_root_ukf,
    "cubature": cubature,
}
each_filter = pytest.mark.parametrize("method", FILTERS.values(), ids=FILTERS.keys())
FIELDS = ("mean", "cov", "predicted_mean", "predicted_cov", "innovation", "innovation_cov", "nis")
STEPS = 8

# ---------------------------------------------------------------------------------------- random worlds


@st.composite
def linear_worlds(draw, runs=((), (3,), (2, 2))):
    """What `track` takes: n of 1 to 5 states, m of 1 to n components, full Q and R, a partial H with one row
    that need not be there, inputs or none, runs or none, any component missing now and then."""
    n = draw(st.integers(1, 5))
    m, inputs = draw(st.integers(1, n)), draw(st.integers(0, 2))
    lead, seed = draw(st.sampled_from(runs)), draw(st.integers(0, 10**6))
    rng = stream(f"tests/properties/linear/{seed}")
    F = rng.standard_normal((n, n))
    F *= draw(st.sampled_from([0.5, 0.97, 1.05])) / np.abs(np.linalg.eigvals(F)).max()
    model = LinearModel(F, rng.standard_normal((n, inputs)))
    H = rng.standard_normal((m, n)) * (rng.random((m, n)) < 0.7)
    sensor = sensors.linear(H, random_covariance(rng, m))
    prior, Q = Gaussian(rng.standard_normal(n), random_covariance(rng, n)), random_covariance(rng, n)
    us = rng.standard_normal((*lead, STEPS, inputs))
    z = simulate(model, sensor, rng.standard_normal((*lead, n)), STEPS, Q, rng, us)[1]
    if draw(st.booleans()):
        z = np.where(rng.random(z.shape) < 0.4, np.nan, z)
    return dict(prior=prior, model=model, sensor=sensor, z=z, Q=Q, us=us)


@st.composite
def pendulum_worlds(draw, runs=4):
    """A double pendulum of any masses, lengths and damping, or a driven simple one, from any angle, anywhere
    on its circle, some of whose states are measured, now and then."""
    rng = stream(f"tests/properties/pendulum/{draw(st.integers(0, 10**6))}")
    system, us = draw(pendulums()), None
    model = discretize(system, 0.01, draw(st.sampled_from(["euler", "symplectic_euler", "midpoint", "rk4"])))
    measured = draw(st.lists(st.sampled_from(system.state_names), min_size=1, unique=True))
    sensor = sensors.components(system, measured, draw(st.sampled_from([0.001, 0.05])) ** 2)
    if system.m:
        us = rng.standard_normal((runs, STEPS, system.m))
    prior = Gaussian(rng.uniform(-4, 4, system.n), 0.05**2 * random_covariance(rng, system.n))
    Q = white_acceleration(model, 0.1) + 1e-8 * random_covariance(rng, system.n)
    z = simulate(model, sensor, prior.sample(rng, runs), STEPS, Q, rng, us)[1]
    z = np.where(rng.random(z.shape) < draw(st.sampled_from([0.0, 0.3])), np.nan, z)
    return dict(prior=prior, model=model, sensor=sensor, z=z, Q=Q, us=us)


@st.composite
def pendulums(draw):
    size, friction = st.floats(0.2, 3.0), st.floats(0.0, 0.5)
    if draw(st.booleans()):
        return systems.simple_pendulum(mass=draw(size), length=draw(size), damping=draw(friction))
    return systems.double_pendulum(
        m1=draw(size), m2=draw(size), l1=draw(size), l2=draw(size), b1=draw(friction), b2=draw(friction)
    )


def assert_same(found, expected, tolerance, fields=FIELDS):
    """Every field, to a tolerance relative to the largest entry of that field."""
    for name in (*fields, "log_likelihood"):
        a, b = getattr(found, name), getattr(expected, name)
        assert a.shape == b.shape, name
        scale = max(1.0, np.nanmax(np.abs(b), initial=0.0))
        np.testing.assert_allclose(a, b, rtol=0, atol=tolerance * scale, err_msg=name)


def assert_covariances(*stacks):
    """Symmetric to the last bit, and positive definite to the rounding of its largest eigenvalue."""
    for cov in stacks:
        np.testing.assert_array_equal(cov, np.swapaxes(cov, -1, -2))
        values = np.linalg.eigvalsh(cov)
        assert (values[..., 0] > -1e-13 * values[..., -1]).all(), values[..., 0].min()


def one_run(world, run):
    """Run number ``run`` of a world, alone."""
    us = None if world["us"] is None else world["us"][run]
    return world | {"z": world["z"][run], "us": us}


# ------------------------------------------------------------------------------- linear: all filters are one


@each_filter
@laws
@given(world=linear_worlds())
def test_every_filter_is_the_kalman_filter_on_every_linear_model(method, world):
    assert_same(track(**world, method=method), track(**world, method=kalman), 1e-9)


@laws
@given(world=linear_worlds(), alpha=st.floats(0.1, 2), beta=st.floats(0, 3), kappa=st.floats(-0.9, 4))
def test_every_point_set_gives_the_kalman_filter_on_every_linear_model(world, alpha, beta, kappa):
    """The centre's weight may be as negative as it likes: of a linear step it sees nothing."""
    points = sigma_points.scaled(alpha, beta, kappa)
    assert_same(track(**world, method=ukf, points=points), track(**world, method=kalman), 1e-8)


@pytest.mark.parametrize("method", [kalman, *FILTERS.values()], ids=["kalman", *FILTERS])
@laws
@given(world=linear_worlds(), data=st.data())
def test_order_and_units_of_states_and_measurements_change_nothing_but_themselves(method, world, data):
    model, sensor = world["model"], world["sensor"]
    A = data.draw(rewritings(model.n), label="states")
    B = data.draw(rewritings(sensor.m), label="measurements")
    back = np.linalg.inv(A)
    prior = Gaussian(A @ world["prior"].mean, A @ world["prior"].cov @ A.T)
    order, units = B.argmax(axis=1), B.max(axis=1)
    rewritten = dict(
        prior=prior,
        model=LinearModel(A @ model.F @ back, A @ model.G),
        sensor=sensors.linear(B @ sensor.H @ back, B @ sensor.R @ B.T),
        z=units * world["z"][..., order],
        Q=A @ world["Q"] @ A.T,
        us=world["us"],
    )
    found, expected = track(**rewritten, method=method), track(**world, method=method)
    np.testing.assert_allclose(found.nis, expected.nis, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(found.mean @ back.T, expected.mean, rtol=1e-7, atol=1e-8)
    scale = np.abs(expected.cov).max()
    np.testing.assert_allclose(back @ found.cov @ back.T, expected.cov, rtol=0, atol=1e-9 * scale)
    jacobian = (~np.isnan(rewritten["z"]) * np.log(units)).sum(axis=-1)  # a density is per unit
    np.testing.assert_allclose(found.log_likelihood + jacobian, expected.log_likelihood, rtol=0, atol=1e-8)


@st.composite
def rewritings(draw, n):
    """A permutation and a change of units: one positive number in each row and column."""
    order = draw(st.permutations(range(n)))
    powers = draw(st.lists(st.integers(-3, 3), min_size=n, max_size=n))
    return np.diag(10.0 ** np.array(powers))[list(order)]


class Rewritten:
    """A model in other coordinates x' = A x."""

    is_linear = False
    runs = ()

    def __init__(self, model, A):
        self.model, self.A, self.back = model, A, np.linalg.inv(A)
        self.n, self.m = model.n, model.m
        self.is_angle = np.zeros(model.n, dtype=bool)
        self.state_names = tuple(f"s{i}" for i in range(model.n))

    def step(self, x, u=None):
        return self.model.step(x @ self.back.T, u) @ self.A.T

    def tangent(self, x, u=None):
        moved, F = self.model.tangent(x @ self.back.T, u)
        return moved @ self.A.T, self.A @ F @ self.back


@few
@given(world=pendulum_worlds(), data=st.data())
def test_order_and_units_change_nothing_for_the_extended_filter_on_pendulums(world, data):
    A = data.draw(rewritings(world["model"].n), label="states")
    back = np.linalg.inv(A)
    sensor = sensors.linear(world["sensor"].H, world["sensor"].R)  # on the line: angles have their own unit
    rewritten = world | dict(
        prior=Gaussian(A @ world["prior"].mean, A @ world["prior"].cov @ A.T),
        model=Rewritten(world["model"], A),
        sensor=sensors.linear(sensor.H @ back, sensor.R),
        Q=A @ world["Q"] @ A.T,
    )
    found, expected = track(**rewritten, method=ekf), track(**world | {"sensor": sensor}, method=ekf)
    np.testing.assert_allclose(found.mean @ back.T, expected.mean, rtol=0, atol=1e-8)
    scale = np.abs(expected.cov).max()
    np.testing.assert_allclose(back @ found.cov @ back.T, expected.cov, rtol=0, atol=1e-8 * scale)
    np.testing.assert_allclose(found.nis, expected.nis, rtol=1e-6, atol=1e-8)


# ----------------------------------------------------------------------------------- batch, gaps, beliefs


@pytest.mark.parametrize("method", [kalman, *FILTERS.values()], ids=["kalman", *FILTERS])
@few
@given(world=linear_worlds(runs=((3,), (2, 2))))
def test_batch_is_a_loop_on_linear_models(method, world):
    together = track(**world, method=method)
    for run in np.ndindex(world["z"].shape[:-2]):
        alone = track(**one_run(world, run), method=method)
        assert_same(of_run(together, run), alone, 1e-10)


@each_filter
@few
@given(world=pendulum_worlds())
def test_batch_is_a_loop_on_pendulums(method, world):
    together = track(**world, method=method)
    for run in np.ndindex(world["z"].shape[:-2]):
        alone = track(**one_run(world, run), method=method)
        assert_same(of_run(together, run), alone, 1e-9)


def of_run(result, run):
    return SimpleNamespace(**{name: getattr(result, name)[run] for name in (*FIELDS, "log_likelihood")})


@pytest.mark.parametrize("method", [kalman, *FILTERS.values()], ids=["kalman", *FILTERS])
@laws
@given(world=linear_worlds(runs=((),)), data=st.data())
def test_missing_component_is_a_sensor_without_it(method, world, data):
    belief, sensor, z = world["prior"], world["sensor"], np.nan_to_num(world["z"][0])
    seen = data.draw(
        st.lists(st.integers(0, sensor.m - 1), min_size=1, unique=True).map(sorted), label="seen"
    )
    holes = np.full(sensor.m, np.nan)
    holes[seen] = z[seen]
    fewer = sensors.linear(sensor.H[seen], sensor.R[np.ix_(seen, seen)])
    found, expected = method.update(belief, holes, sensor), method.update(belief, z[seen], fewer)
    np.testing.assert_allclose(found.posterior.mean, expected.posterior.mean, rtol=0, atol=1e-11)
    np.testing.assert_allclose(found.posterior.cov, expected.posterior.cov, rtol=0, atol=1e-11)
    np.testing.assert_allclose(found.gain[:, seen], expected.gain, rtol=0, atol=1e-11)
    np.testing.assert_allclose(found.innovation[seen], expected.innovation, rtol=0, atol=1e-12)
    assert found.nis == pytest.approx(expected.nis, rel=1e-9, abs=1e-12)
    assert found.log_likelihood == pytest.approx(expected.log_likelihood, rel=1e-9, abs=1e-11)
    absent = np.setdiff1d(range(sensor.m), seen)
    np.testing.assert_array_equal(found.gain[:, absent], 0.0)
    assert np.isnan(found.innovation[absent]).all()


@pytest.mark.parametrize("method", [kalman, *FILTERS.values()], ids=["kalman", *FILTERS])
@few
@given(world=linear_worlds())
def test_measurement_never_enlarges_a_covariance_on_linear_models(method, world):
    assert_no_larger(track(**world, method=method))


@each_filter
@few
@given(world=pendulum_worlds())
def test_measurement_never_enlarges_a_covariance_on_pendulums(method, world):
    assert_no_larger(track(**world, method=method))


def assert_no_larger(result):
    """Loewner's order: P⁻ − P has no negative eigenvalue. And all of it consists of covariances."""
    assert_covariances(result.cov, result.predicted_cov, result.innovation_cov)
    gained = np.linalg.eigvalsh(result.predicted_cov - result.cov)
    size = np.linalg.eigvalsh(result.predicted_cov)[..., -1]
    assert (gained[..., 0] >= -1e-12 * size).all(), (gained[..., 0] / size).min()


@pytest.mark.parametrize("method", [kalman, *FILTERS.values()], ids=["kalman", *FILTERS])
@laws
@given(world=linear_worlds(runs=((),)), data=st.data())
def test_log_likelihood_of_two_sensors_is_the_sum_of_one_after_the_other(method, world, data):
    """p(z₁, z₂) = p(z₁) p(z₂ | z₁), for errors that are independent; the beliefs agree as well."""
    belief, H, z = world["prior"], world["sensor"].H, world["z"][0]
    m = len(H)
    cut = data.draw(st.integers(0, m), label="cut")
    first = np.arange(m) < cut
    R = np.where(first[:, None] == first, world["sensor"].R, 0.0)
    together = method.update(belief, z, sensors.linear(H, R))
    total, after = 0.0, belief
    for part in (slice(0, cut), slice(cut, m)):
        if part.start < part.stop:
            update = method.update(after, z[part], sensors.linear(H[part], R[part, part]))
            total, after = total + update.log_likelihood, update.posterior
    assert together.log_likelihood == pytest.approx(total, rel=1e-9, abs=1e-10)
    np.testing.assert_allclose(together.posterior.mean, after.mean, rtol=0, atol=1e-10)
    np.testing.assert_allclose(together.posterior.cov, after.cov, rtol=0, atol=1e-10)


@each_filter
@few
@given(world=pendulum_worlds(), cut=st.integers(1, STEPS - 1))
def test_track_is_its_beginning_and_what_follows_from_there(method, world, cut):
    """The log-likelihood of all measurements is that of the first ones and that of the rest, given these."""
    us, z = world["us"], world["z"]
    first, rest = (None, None) if us is None else (us[:, :cut], us[:, cut:])
    whole = track(**world, method=method)
    before = track(**world | {"z": z[:, :cut], "us": first}, method=method)
    after = track(**world | {"prior": before.belief(cut - 1), "z": z[:, cut:], "us": rest}, method=method)
    total = before.log_likelihood.sum(axis=-1) + after.log_likelihood.sum(axis=-1)
    np.testing.assert_allclose(total, whole.log_likelihood.sum(axis=-1), rtol=1e-9, atol=1e-7)
    np.testing.assert_allclose(after.mean, whole.mean[:, cut:], rtol=0, atol=1e-9)


@each_filter
@few
@given(world=pendulum_worlds(), turns=st.integers(-3, 3), data=st.data())
def test_whole_turns_of_what_is_measured_change_nothing(method, world, turns, data):
    sensor = world["sensor"]
    i = data.draw(st.integers(0, sensor.m - 1), label="component")
    shift = np.where((np.arange(sensor.m) == i) & sensor.is_angle, 2 * np.pi * turns, 0.0)
    found, expected = track(**world | {"z": world["z"] + shift}, method=method), track(**world, method=method)
    np.testing.assert_allclose(found.mean, expected.mean, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.nis, expected.nis, rtol=1e-6, atol=1e-7)


# ------------------------------------------------------------------------------------------------ steps


@pytest.mark.parametrize("method", ["euler", "symplectic_euler", "midpoint", "rk4"])
@laws
@given(system=pendulums(), seed=st.integers(0, 10**6), dt=st.floats(1e-3, 0.1))
def test_tangent_is_the_derivative_of_the_step(method, system, seed, dt):
    """By complex steps, which have no rounding of differences: ∂Φ/∂xᵢ = Im Φ(x + ih eᵢ)/h."""
    rng = stream(f"tests/properties/tangent/{seed}")
    model = discretize(system, dt, method)
    x, u = rng.uniform(-4, 4, system.n), rng.standard_normal(system.m) if system.m else None
    h = 1e-30
    F = np.stack([model.step(x + 1j * h * e, u).imag / h for e in np.eye(system.n)], axis=-1)
    moved, tangent = model.tangent(x, u)
    scale = max(1.0, np.abs(F).max())
    np.testing.assert_allclose(tangent, F, rtol=0, atol=1e-11 * scale)
    np.testing.assert_allclose(moved, model.step(x, u), rtol=0, atol=1e-12 * scale)
    np.testing.assert_array_equal(model.jacobian(x, u), tangent)
    if system.m:
        h = 1e-4
        G = [(model.step(x, u + h * e) - model.step(x, u - h * e)) / (2 * h) for e in np.eye(system.m)]
        np.testing.assert_allclose(model.input_jacobian(x, u), np.stack(G, axis=-1), rtol=0, atol=1e-7)


@pytest.mark.parametrize("method", ["euler", "midpoint", "rk4", "exact", "exact_foh"])
@few
@given(n=st.integers(1, 3), m=st.integers(1, 2), seed=st.integers(0, 10**6), dt=st.floats(1e-3, 0.3))
def test_tangent_is_the_derivative_of_the_step_of_linear_systems(method, n, m, seed, dt):
    """A linear step is its value at rest and its derivatives, at any distance."""
    rng = stream(f"tests/properties/linear tangent/{seed}")
    model = discretize(systems.linear(rng.standard_normal((n, n)), rng.standard_normal((n, m))), dt, method)
    x, u = rng.standard_normal((5, n)), rng.standard_normal((5, model.m))
    moved, F = model.tangent(x, u)
    rest = model.step(np.zeros(n), np.zeros(model.m))
    straight = rest + np.einsum("...ij,...j->...i", F, x)
    straight = straight + np.einsum("...ij,...j->...i", model.input_jacobian(x, u), u)
    np.testing.assert_allclose(moved, straight, rtol=0, atol=1e-12 * max(1.0, np.abs(moved).max()))
    np.testing.assert_allclose(model.step(x, u), moved, rtol=0, atol=1e-12)


# ----------------------------------------------------------------------------------------------- circle

ANGLE = st.floats(-1e3, 1e3)


@laws
@given(angle=ANGLE, turns=st.integers(-100, 100))
def test_wrapped_angle_is_the_same_angle_within_half_a_turn(angle, turns):
    wrapped = angles.wrap(angle)
    assert abs(wrapped) <= np.pi * (1 + 1e-12)
    assert abs((angle - wrapped) / (2 * np.pi) - round(float(angle - wrapped) / (2 * np.pi))) < 1e-12
    assert np.cos(wrapped) == pytest.approx(np.cos(angle), abs=1e-11)
    assert np.sin(wrapped) == pytest.approx(np.sin(angle), abs=1e-11)
    same = angles.wrap(angle + 2 * np.pi * turns)
    assert abs(angles.wrap(same - wrapped)) < 1e-10
    if abs(angle) <= np.pi:
        assert wrapped == angle


@laws
@given(a=st.lists(ANGLE, min_size=3, max_size=3), b=st.lists(ANGLE, min_size=3, max_size=3))
def test_residual_leads_from_one_angle_to_the_other_the_short_way(a, b):
    mask = np.array([True, False, True])
    a, b = np.array(a), np.array(b)
    d = angles.residual(a, b, mask)
    assert d[1] == a[1] - b[1]
    assert (np.abs(d[mask]) <= np.pi * (1 + 1e-12)).all()
    np.testing.assert_allclose(np.exp(1j * (b + d)[mask]), np.exp(1j * a[mask]), rtol=0, atol=1e-10)
    back = angles.residual(b, a, mask)
    np.testing.assert_allclose(np.exp(1j * back[mask]), np.exp(-1j * d[mask]), rtol=0, atol=1e-10)
    np.testing.assert_array_equal(angles.residual(a, a, mask), 0.0)


@laws
@given(data=st.data(), n=st.integers(1, 3), k=st.integers(1, 6))
def test_mean_turns_with_its_points_and_does_not_see_whole_turns(data, n, k):
    rng = stream(f"tests/properties/mean/{data.draw(st.integers(0, 10**6))}")
    mask = np.array(data.draw(st.lists(st.booleans(), min_size=n, max_size=n)))
    spread = data.draw(st.floats(0.01, 1.5))  # no point is half a turn from the first: there it is unstable
    points = rng.uniform(-10, 10, n) + rng.uniform(-spread, spread, (2, k, n))
    weights = rng.standard_normal(k)
    weights[0] += 1 - weights.sum()  # negative ones too
    found = angles.mean(points, weights, mask)
    np.testing.assert_allclose(found, np.einsum("k,rkn->rn", weights, points), rtol=0, atol=1e-11)
    turned = angles.mean(points + 0.7, weights, mask)
    np.testing.assert_allclose(turned, found + 0.7, rtol=0, atol=1e-11)
    turns = 2 * np.pi * rng.integers(-3, 4, points.shape) * mask
    turns[:, 0] = 0.0  # the mean stays on the turn of the first point
    np.testing.assert_allclose(angles.mean(points + turns, weights, mask), found, rtol=0, atol=1e-10)


# --------------------------------------------------------------------------------------------- long runs


@pytest.mark.parametrize("method", [kalman, square_root_ukf], ids=["kalman", "square_root_ukf"])
def test_long_runs_stay_covariances(method):
    """One track of a double integrator, which forgets nothing by itself, and of which every third position
    is missing. Nothing is repaired on the way: what stays symmetric and positive stays so by its form."""
    steps = {kalman: 100_000, square_root_ukf: 5_000}[method]
    rng = stream("tests/long runs/linear")
    model = LinearModel([[1.0, 0.01], [0.0, 1.0]])
    sensor = sensors.linear([[1.0, 0.0]], 1e-6)
    z = 1e-3 * rng.standard_normal((steps, 1))
    z[::3] = np.nan
    result = track(Gaussian([0.0, 0.0], [1.0, 100.0]), model, sensor, z, [1e-12, 1e-8], method=method)
    assert_positive(result)


@pytest.mark.parametrize("method", [ekf, ukf, square_root_ukf], ids=["ekf", "ukf", "square_root_ukf"])
def test_long_runs_of_many_pendulums_stay_covariances(method):
    """A hundred tracks of a thousand steps each: 10⁵ in all."""
    rng = stream("tests/long runs/pendulum")
    system = systems.simple_pendulum(damping=0.05)
    model, sensor = discretize(system, 0.01), sensors.components(system, ["theta"], 1e-6)
    prior, Q = Gaussian([2.0, 0.0], [0.1**2, 0.1**2]), white_acceleration(model, 1e-4)
    z = simulate(model, sensor, prior, 1000, Q, rng, runs=100)[1]
    assert_positive(track(prior, model, sensor, z, Q, method=method))


def assert_positive(result):
    """Symmetric to the last bit and positive definite, every one."""
    for cov in (result.cov, result.predicted_cov, result.innovation_cov):
        np.testing.assert_array_equal(cov, np.swapaxes(cov, -1, -2))
        assert np.isfinite(cov).all()
        assert np.linalg.eigvalsh(cov)[..., 0].min() > 0
