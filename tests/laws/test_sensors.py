"""Sensors: their Jacobians, their angles, what an encoder does to a filter, and biases as states."""

import numpy as np
import pytest
from worlds import linear_world

from pendulab import (
    Gaussian,
    LinearModel,
    angles,
    augment,
    consistency,
    cubature,
    discretize,
    ekf,
    iterated_ekf,
    kalman,
    linearise,
    sensors,
    simulate,
    smooth,
    square_root_ukf,
    stream,
    systems,
    track,
    ukf,
    white_acceleration,
    with_bias_states,
)

DOUBLE = systems.double_pendulum(l1=0.7, l2=0.4)
LANDMARKS = np.array([[3.0, 1.0], [-2.0, 2.5], [0.5, -4.0]])


def camera(R=1.0):
    return sensors.joint_pixels(DOUBLE, R, scale=200.0, pivot=(320.0, 100.0))


def beacon(**changes):
    return sensors.range_bearing(**dict(landmarks=LANDMARKS, R=[0.1**2, 0.02**2]) | changes)


def biased_camera():
    return sensors.with_bias(camera(), ["row2", "column1"])


def biased_beacon():
    return sensors.with_bias(beacon(n=4), ["bearing1"])


CURVED = dict(camera=camera, beacon=beacon, biased_camera=biased_camera, biased_beacon=biased_beacon)
each_sensor = pytest.mark.parametrize("make", CURVED.values(), ids=CURVED.keys())


@each_sensor
def test_jacobian_is_that_of_the_measurement(make):
    """Central differences, residuals wrapped; for one state and for a batch of runs."""
    sensor, h = make(), 1e-6
    x = stream("tests/sensor jacobian").uniform(-1.5, 1.5, (4, 3, sensor.n))
    H = sensor.jacobian(x)
    assert H.shape == (4, 3, sensor.m, sensor.n)
    for j, e in enumerate(np.eye(sensor.n)):
        slope = sensor.residual(sensor.h(x + h * e), sensor.h(x - h * e)) / (2 * h)
        np.testing.assert_allclose(H[..., j], slope, rtol=0, atol=2e-8 * np.abs(H).max())
    np.testing.assert_allclose(sensor.jacobian(x[0, 0]), H[0, 0], rtol=1e-14, atol=1e-14)
    np.testing.assert_allclose(sensor.h(x[0, 0]), sensor.h(x)[0, 0], rtol=1e-14, atol=1e-12)


def test_jacobian_of_the_pixels_by_complex_steps():
    """No difference is taken, so all digits count."""
    x = stream("tests/complex step").uniform(-3, 3, (5, 4))
    for j, e in enumerate(np.eye(4)):
        slope = camera().h(x + 1e-30j * e).imag / 1e-30
        np.testing.assert_allclose(camera().jacobian(x)[..., j], slope, rtol=1e-14, atol=1e-12)


def test_jacobian_of_range_and_bearing_by_complex_steps_of_its_definition():
    x = np.array([0.3, -0.2, 0.4])
    for j, e in enumerate(np.eye(3)):
        c = x + 1e-30j * e
        d = LANDMARKS - c[:2]
        r, bearing = np.sqrt(d[:, 0] ** 2 + d[:, 1] ** 2), np.arctan(d[:, 1] / d[:, 0]) - c[2]
        slope = np.stack([r, bearing], axis=-1).ravel().imag / 1e-30
        np.testing.assert_allclose(beacon().jacobian(x)[:, j], slope, rtol=1e-13, atol=1e-14)


@each_sensor
def test_sensor_keeps_the_protocol_and_refuses_another_size(make):
    sensor = make()
    assert len(sensor.names) == len(sensor.units) == len(sensor.is_angle) == sensor.m == len(sensor.R)
    assert len(set(sensor.names)) == sensor.m
    assert not sensor.is_linear
    z = np.zeros(sensor.m)
    expected = np.where(sensor.is_angle, 7.0 - 2 * np.pi, 7.0)
    np.testing.assert_allclose(sensor.residual(z + 7.0, z), expected, rtol=1e-14)
    with pytest.raises(ValueError, match=rf"z: expected shape \(\.\.\., {sensor.m}\) for .* got \(1,\)"):
        sensor.residual(np.zeros(1), z)


# ------------------------------------------------------------------------------------ range and bearing


def test_range_and_bearing_of_places_that_are_known():
    sensor = sensors.range_bearing([[1.0, 0.0], [0.0, -2.0], [-3.0, 0.0]], 0.1)
    np.testing.assert_allclose(sensor.h([0, 0, 0]), [1, 0, 2, -np.pi / 2, 3, np.pi], atol=1e-15)
    turned = sensor.h([0.0, 0.0, np.pi / 2])
    np.testing.assert_allclose(turned, [1, -np.pi / 2, 2, -np.pi, 3, np.pi / 2], atol=1e-15)
    around = sensor.h(np.c_[np.zeros((50, 2)), np.linspace(-9, 9, 50)])[:, 1::2]
    assert np.abs(around).max() <= np.pi < np.ptp(around)
    np.testing.assert_array_equal(sensors.with_bias(sensor, ["range0"]).is_angle, [False, True] * 3)
    assert sensor.names == ("range0", "bearing0", "range1", "bearing1", "range2", "bearing2")
    assert sensor.units == ("m", "rad") * 3


def test_states_may_stand_in_any_order_with_others_beside():
    sensor, x = beacon(position=(3, 1), heading=0, n=5), np.array([0.4, -0.2, 9.0, 0.3, 7.0])
    plain, y = beacon(), np.array([0.3, -0.2, 0.4])
    np.testing.assert_array_equal(sensor.h(x), plain.h(y))
    np.testing.assert_array_equal(sensor.jacobian(x)[:, [3, 1, 0]], plain.jacobian(y))
    np.testing.assert_array_equal(sensor.jacobian(x)[:, [2, 4]], 0.0)


def test_variances_of_range_and_bearing_are_those_of_every_landmark():
    np.testing.assert_array_equal(np.diag(beacon(R=[4.0, 9.0]).R), [4, 9, 4, 9, 4, 9])
    np.testing.assert_array_equal(np.diag(beacon(R=np.arange(1.0, 7.0)).R), np.arange(1.0, 7.0))
    assert beacon(R=np.ones((8, 1, 1)) * np.eye(6)).R.shape == (8, 6, 6)


def test_range_and_bearing_refuse_what_has_no_meaning():
    with pytest.raises(ValueError, match=r"a state stands on landmark 1 at \[-2.   2.5\] m: range 0"):
        beacon().h([[0.0, 0.0, 0.0], [-2.0, 2.5, 0.3]])
    with pytest.raises(ValueError, match="a state stands on landmark 0"):
        beacon().jacobian([3.0, 1.0, 0.3])
    with pytest.raises(ValueError, match=r"landmarks: expected finite places of shape \(k, 2\)"):
        beacon(landmarks=np.zeros((2, 3)))
    for wrong in (dict(heading=1), dict(position=(0, 0)), dict(n=2), dict(position=(-1, 0))):
        with pytest.raises(ValueError, match="expected three different states below n="):
            beacon(**wrong)
    with pytest.raises(ValueError, match=r"R: expected a scalar, 6 variances"):
        beacon(R=np.ones(4))
    with pytest.raises(ValueError, match=r"x: expected states of shape \(..., 3\), got \(4,\)"):
        beacon().h(np.zeros(4))


@pytest.mark.parametrize(
    "method", [ekf, ukf, iterated_ekf, cubature, square_root_ukf], ids=lambda m: m.__name__.split(".")[-1]
)
def test_vehicle_is_followed_behind_the_landmark_where_bearings_jump(method):
    """Standing with its back to the landmark: half of the bearings are near π, half near −π. 200 runs,
    average NEES in its 99.9 % band; without wrapping, residuals of 2π are taken for errors."""
    rng = stream("tests/back to the landmark")
    still, sensor = (
        LinearModel(np.eye(3)),
        sensors.range_bearing([[-4.0, 0.0], [0.0, 5.0]], [0.05**2, 0.03**2]),
    )
    prior = Gaussian([0.0, 0.0, 0.0], np.array([0.1, 0.1, 0.05]) ** 2)
    truth, z = simulate(still, sensor, prior, 10, 0.0, rng, runs=200)
    assert 0.3 < (z[..., 1] > 0).mean() < 0.7
    result = track(prior, still, sensor, z, 1e-12, method=method)
    low, high = consistency.chi2_band(3, 200, 0.999)
    nees = consistency.nees(result.mean[:, -1], result.cov[:, -1], truth[:, -1]).mean()
    assert low < nees < high


# ----------------------------------------------------------------------------------------------- pixels


def test_pixels_of_a_pendulum_stretched_to_the_right_and_folded():
    np.testing.assert_allclose(camera().h([np.pi / 2, 5, np.pi / 2, 5]), [460, 100, 540, 100], rtol=1e-14)
    np.testing.assert_allclose(camera().h([0, 5, np.pi, 5]), [320, 240, 320, 160], rtol=1e-14)
    single = sensors.joint_pixels(discretize(systems.simple_pendulum(length=0.5), 0.1), 1.0, 100.0)
    np.testing.assert_allclose(single.h([np.pi / 6, 0]), [25, 50 * np.cos(np.pi / 6)], rtol=1e-14)
    assert camera().names == ("column1", "row1", "column2", "row2")


def test_pixels_need_lengths_and_a_scale():
    light = systems.reduced(DOUBLE)
    with pytest.raises(ValueError, match=r"lengths: .* does not tell one length for each angle; give them"):
        sensors.joint_pixels(light, 1.0, 200.0)
    given = sensors.joint_pixels(light, 1.0, 200.0, (320.0, 100.0), lengths=[0.7, 0.4])
    np.testing.assert_array_equal(given.h([0.1, 0, 0.2, 0]), camera().h([0.1, 0, 0.2, 0]))
    for wrong in ([0.7], [0.7, -0.4], [0.7, np.nan]):
        with pytest.raises(ValueError, match="lengths: expected 2 positive numbers in metres"):
            sensors.joint_pixels(DOUBLE, 1.0, 200.0, lengths=wrong)
    for scale, pivot in ((0.0, (0, 0)), (np.inf, (0, 0)), (1.0, (0, 0, 0)), (1.0, (0, np.nan))):
        with pytest.raises(ValueError, match="expected a positive scale in px/m and a pivot"):
            sensors.joint_pixels(DOUBLE, 1.0, scale, pivot)


@pytest.mark.parametrize("method", [ekf, ukf, cubature], ids=["ekf", "ukf", "cubature"])
def test_filter_on_pixels_is_consistent(method):
    rng, model = stream("tests/pixels"), discretize(DOUBLE, 0.02)
    prior, Q = Gaussian([0.5, 0.0, -0.3, 0.0], np.array([0.05, 0.1, 0.05, 0.1]) ** 2), 1e-6
    truth, z = simulate(model, camera(4.0), prior, 30, Q, rng, runs=200)
    result = track(prior, model, camera(4.0), z, Q, method=method)
    low, high = consistency.chi2_band(4, 200 * 30, 0.999)
    assert low < result.nis.mean() < high
    low, high = consistency.chi2_band(4, 200, 0.999)
    assert low < consistency.nees(result.mean[:, -1], result.cov[:, -1], truth[:, -1]).mean() < high


# --------------------------------------------------------------------------------------------- encoders

ENCODERS = dict(rounding=(sensors.rounding_encoder, 0.0), flooring=(sensors.flooring_encoder, -0.5))
each_encoder = pytest.mark.parametrize(("make", "mean"), ENCODERS.values(), ids=ENCODERS.keys())


@each_encoder
def test_encoder_errs_by_what_it_says(make, mean):
    """States spread over 1,000 steps: readings are whole steps, their errors have mean h(x) − x and variance
    R, to 4.5 standard errors, and none is larger than one step."""
    q = np.array([0.1, 0.02])
    encoder = make(DOUBLE, ["theta2", "omega1"], q)
    x = stream("tests/encoder").uniform(-50 * q.max(), 50 * q.max(), (20_000, 4))
    reading = encoder.sample(x, None)
    np.testing.assert_allclose(reading / q, np.rint(reading / q), rtol=0, atol=1e-9)
    error = reading - x[:, [2, 1]]
    assert (error.min(axis=0) >= (mean - 0.5) * q - 1e-12).all()
    assert (error.max(axis=0) <= (mean + 0.5) * q + 1e-12).all()
    np.testing.assert_allclose(
        encoder.h(x) - x[:, [2, 1]], np.broadcast_to(mean * q, (20_000, 2)), atol=1e-12
    )
    assert (np.abs(error.mean(axis=0) - mean * q) < 4.5 * q / np.sqrt(12 * 20_000)).all()
    np.testing.assert_allclose(error.var(axis=0), np.diag(encoder.R), rtol=4.5 * np.sqrt(0.8 / 20_000))
    np.testing.assert_allclose(np.diag(encoder.R), q**2 / 12, rtol=1e-14)


@each_encoder
def test_simulate_takes_the_encoders_readings(make, mean):
    encoder = make(DOUBLE, ["theta1"], 0.05)
    truth, z = simulate(
        discretize(DOUBLE, 0.02), encoder, [0.5, 0, 0, 0], 50, 1e-6, stream("tests/read"), runs=3
    )
    assert z.shape == (3, 50, 1)
    np.testing.assert_array_equal(z, encoder.sample(truth, None))


@each_encoder
@pytest.mark.parametrize("method", [ekf, ukf, kalman], ids=["ekf", "ukf", "kalman"])
def test_filter_of_an_encoder_is_without_bias_and_nearly_consistent(make, mean, method):
    """A wheel that turns by many steps between readings, so their errors are as good as independent: 400
    runs, the mean error within 4.5 standard errors of zero, NIS near one. (It has no χ² law: its errors are
    uniform.) A filter of the flooring encoder that is not told of the half step is wrong by it."""
    rng, system = stream("tests/wheel"), systems.simple_pendulum(gravity=0.0)
    model = linearise.model(discretize(system, 0.1), [0.0, 0.0])
    encoder, prior = make(system, ["theta"], 0.01), Gaussian([0.0, 2.0], [0.1**2, 0.5**2])
    truth, z = simulate(model, encoder, prior, 30, white_acceleration(model, 0.01), rng, runs=400)
    result = track(prior, model, encoder, z, white_acceleration(model, 0.01), method=method)
    error = angles.wrap(truth[:, -1, 0] - result.mean[:, -1, 0])
    assert abs(error.mean()) < 4.5 * error.std() / np.sqrt(400)
    assert error.std() / result.std[0, -1, 0] == pytest.approx(1.0, abs=0.16)  # 4.5/√800
    assert result.nis[:, 5:].mean() == pytest.approx(1.0, abs=0.05)
    if mean:
        untold = sensors.components(system, ["theta"], encoder.R)
        wrong = track(prior, model, untold, z, white_acceleration(model, 0.01), method=method).mean[:, -1, 0]
        assert angles.wrap(truth[:, -1, 0] - wrong).mean() == pytest.approx(0.005, abs=0.001)


def test_encoder_steps_are_positive():
    for step in (0.0, -0.1, np.nan, [0.1, 0.2]):
        with pytest.raises(ValueError, match="step: expected a positive number or 1 of them, got"):
            sensors.rounding_encoder(DOUBLE, ["theta1"], step)


# ------------------------------------------------------------------------------------------------ biases


def test_biases_are_added_to_the_components_they_are_named_after():
    sensor, x, b = biased_camera(), np.array([0.1, 0.2, 0.3, 0.4]), np.array([5.0, -3.0])
    np.testing.assert_allclose(
        sensor.h(np.r_[x, b]), camera().h(x) + np.array([-3.0, 0.0, 0.0, 5.0]), rtol=1e-14
    )
    assert sensor.bias_names == ("bias_row2", "bias_column1")
    assert (sensor.n, sensor.m, sensor.names) == (6, 4, camera().names)
    assert sensors.with_bias(sensors.linear(np.eye(2), 1.0), ["z1"]).is_linear


def test_filter_with_bias_states_is_the_kf_of_the_larger_linear_model():
    world = linear_world("tests/bias is a state", n=3, m=2)
    sensor = sensors.with_bias(world.sensor, ["z1"])
    model = with_bias_states(world.model, sensor)
    F, G = np.zeros((4, 4)), np.r_[world.model.G, [[0.0]]]
    F[:3, :3], F[3, 3] = world.model.F, 1.0
    larger = sensors.linear(np.c_[world.sensor.H, [0.0, 1.0]], world.sensor.R)
    Q = np.zeros((4, 4))
    Q[:3, :3], Q[3, 3] = world.Q, 0.2
    prior = Gaussian(np.r_[world.prior.mean, 0.5], np.eye(4))
    np.testing.assert_array_equal(model.noise(world.Q, walk=0.2), Q)
    expected = track(prior, LinearModel(F, G), larger, world.z, Q, world.us, method=kalman)
    for method in (kalman, ekf, ukf):
        found = track(prior, model, sensor, world.z, model.noise(world.Q, 0.2), world.us, method=method)
        np.testing.assert_allclose(
            found.mean, expected.mean, rtol=0, atol=1e-11 * np.abs(expected.mean).max()
        )
        np.testing.assert_allclose(found.cov, expected.cov, rtol=0, atol=1e-11)
    np.testing.assert_array_equal(model.jacobian(prior.mean), F)
    np.testing.assert_array_equal(model.input_jacobian(prior.mean), G)


@pytest.mark.parametrize("method", [ekf, ukf, cubature], ids=["ekf", "ukf", "cubature"])
def test_bias_and_parameter_are_learned_together(method):
    """A pendulum whose angle sensor is tilted and whose damping is unknown: 100 runs, average NEES of all
    four in its 99.9 % band, and a bias known ten times better than before."""
    rng = stream("tests/bias and parameter")
    system = augment(systems.simple_pendulum(), damping=0.3)
    plain = sensors.components(system, ["theta"], 0.01**2)
    sensor = sensors.with_bias(plain, ["theta"])
    model = with_bias_states(discretize(system, 0.02), sensor)
    assert model.state_names == ("theta", "omega", "damping", "bias_theta")
    prior = Gaussian([0.8, 0.0, 0.3, 0.0], np.array([0.02, 0.05, 0.05, 0.1]) ** 2)
    Q = model.noise([1e-10, 1e-7, 1e-12])
    truth, z = simulate(model, sensor, prior, 250, Q, rng, runs=100)
    np.testing.assert_array_equal(truth[:, :1, 3], truth[:, -1:, 3])
    result = track(prior, model, sensor, z, Q, method=method)
    low, high = consistency.chi2_band(4, 100, 0.999)
    nees = consistency.nees(result.mean[:, -1], result.cov[:, -1], truth[:, -1], model.is_angle)
    assert low < nees.mean() < high
    assert result.std[:, -1, 3].max() < 0.01


def test_biased_encoder_reads_whole_steps_and_a_bias():
    sensor = sensors.with_bias(sensors.flooring_encoder(DOUBLE, ["theta1"], 0.1), ["theta1"])
    x = np.array([0.27, 0.0, 0.0, 0.0, 0.03])
    np.testing.assert_allclose(sensor.sample(x, None), [0.23], rtol=1e-12)
    np.testing.assert_allclose(sensor.h(x), [0.25], rtol=1e-12)
    assert not hasattr(biased_camera(), "sample")


def test_model_of_biases_takes_other_steps_and_is_smoothed():
    system = systems.simple_pendulum()
    sensor = sensors.with_bias(sensors.components(system, ["theta"], 0.01), ["theta"])
    model = with_bias_states(discretize(system, 0.1), sensor)
    np.testing.assert_array_equal(
        model.with_dt(0.05).step([0.3, 0.1, 0.2]), [*discretize(system, 0.05).step([0.3, 0.1]), 0.2]
    )
    Q = lambda m: m.noise(white_acceleration(m.original, 0.1), 1e-6)  # noqa: E731
    arguments = dict(model=model, Q=Q, times=[0.1, 0.15, 0.4])
    result = track(Gaussian([0.3, 0, 0], 0.01), sensor=sensor, z=np.full((3, 1), 0.3), **arguments)
    assert (smooth.extended(result, **arguments).std <= result.std + 1e-12).all()


def test_biases_of_nothing_are_refused():
    for names in ([], "row1", ["row1", "row1"]):
        with pytest.raises(ValueError, match="names: expected a list of different components, got"):
            sensors.with_bias(camera(), names)
    with pytest.raises(KeyError, match="JointPixels has no component 'row3'; did you mean 'row"):
        sensors.with_bias(camera(), ["row3"])
    with pytest.raises(ValueError, match="the sensor looks at 4 states, the model has 2"):
        with_bias_states(LinearModel(np.eye(2)), biased_camera())
    with pytest.raises(ValueError, match=r"x: expected states of shape \(..., 6\), biases last, got \(4,\)"):
        biased_camera().h(np.zeros(4))
    model = with_bias_states(discretize(DOUBLE, 0.1), biased_camera())
    with pytest.raises(ValueError, match=r"x: expected shape \(..., 6\) = .*'bias_column1'\), got \(4,\)"):
        model.step(np.zeros(4))


def test_range_and_bearing_know_states_by_their_names():
    system = augment(systems.ackermann(), wheelbase=0.5)
    by_name = sensors.range_bearing(
        [3.0, 1.0], [0.1, 0.01], ("x", "y"), "heading", system=discretize(system, 0.1)
    )
    by_place = sensors.range_bearing([3.0, 1.0], [0.1, 0.01], n=4)
    x = np.array([0.4, -0.3, 0.8, 0.5])
    np.testing.assert_array_equal(by_name.jacobian(x), by_place.jacobian(x))
    with pytest.raises(KeyError, match="did you mean 'heading'"):
        sensors.range_bearing([3.0, 1.0], [0.1, 0.01], ("x", "y"), "headin", system=system)
    with pytest.raises(ValueError, match="names of states need the system"):
        sensors.range_bearing([3.0, 1.0], [0.1, 0.01], ("x", "y"), "heading")
    with pytest.raises(ValueError, match="has 4 states, got n=3"):
        sensors.range_bearing([3.0, 1.0], [0.1, 0.01], n=3, system=system)


def test_no_complex_step_goes_through_a_bearing():
    """It would give a Jacobian of zeros."""
    sensor = sensors.range_bearing([3.0, 1.0], [0.1, 0.01])
    for function in (sensor.h, sensor.jacobian):
        with pytest.raises(TypeError, match="real states only"):
            function(np.array([0.1 + 1e-20j, 0.2, 0.3]))
