"""Speed, as ratios against a peer in the same process: a busy machine slows both.

CPU time, the best of three. `pytest tests/bench -s` prints the ratios; only those that no machine will upset
are asserted. The whole folder takes a few seconds, so it runs with the other tests.
"""

import time

import filterpy.kalman
import numpy as np
import pytest

from pendulab import (
    Gaussian,
    codegen,
    discretize,
    ekf,
    sensors,
    simulate,
    stream,
    systems,
    track,
    ukf,
    white_acceleration,
)

SYSTEM = systems.double_pendulum()
MODEL, SENSOR = discretize(SYSTEM, 0.01), sensors.components(SYSTEM, SYSTEM.state_names, 0.02**2)
PRIOR, Q = Gaussian([1.0, 0.0, 0.8, 0.0], 0.05**2), white_acceleration(MODEL, 0.01)
each_filter = pytest.mark.parametrize("method", [ekf, ukf], ids=["ekf", "ukf"])


def measurements(runs, steps):
    return simulate(MODEL, SENSOR, PRIOR, steps, Q, stream("bench"), runs=runs)[1]


def cost(work, repeat=3):
    """CPU seconds of the quickest of some repetitions."""
    seconds = []
    for _ in range(repeat):
        start = time.process_time()
        work()
        seconds.append(time.process_time() - start)
    return min(seconds)


def with_filterpy(method, z):
    if method is ekf:
        filter_ = filterpy.kalman.ExtendedKalmanFilter(dim_x=4, dim_z=4)
    else:
        points = filterpy.kalman.MerweScaledSigmaPoints(4, 1.0, 2.0, 0.0)
        filter_ = filterpy.kalman.UnscentedKalmanFilter(
            dim_x=4, dim_z=4, dt=0.01, hx=lambda x: x, fx=lambda x, dt: MODEL.step(x), points=points
        )
    filter_.x, filter_.P, filter_.Q, filter_.R = PRIOR.mean.copy(), PRIOR.cov.copy(), Q, SENSOR.R
    for zk in z:
        if method is ekf:
            filter_.F = MODEL.jacobian(filter_.x)
            filter_.predict_x = lambda u=0: setattr(filter_, "x", MODEL.step(filter_.x))
            filter_.predict()
            filter_.update(zk, lambda x: SENSOR.H, lambda x: x)
        else:
            filter_.predict()
            filter_.update(zk)


@each_filter
def test_batch_of_two_hundred_tracks_costs_less_than_a_fifth_of_a_loop(method):
    """The loop is timed on 10 tracks, and counted 20 times."""
    z = measurements(runs=200, steps=40)
    together = cost(lambda: track(PRIOR, MODEL, SENSOR, z, Q, method=method))
    loop = 20 * cost(lambda: [track(PRIOR, MODEL, SENSOR, one, Q, method=method) for one in z[:10]])
    print(f"\n{method.__name__}, 200 tracks: batch / loop = 1 / {loop / together:.0f}")
    assert together < loop / 5


@each_filter
def test_thousand_tracks_against_one_of_filterpy_times_a_thousand(method):
    z = measurements(runs=1000, steps=20)
    ours = cost(lambda: track(PRIOR, MODEL, SENSOR, z, Q, method=method))
    theirs = 200 * cost(lambda: [with_filterpy(method, one) for one in z[:5]])
    print(f"\n{method.__name__}, 1,000 tracks: pendulab / filterpy = 1 / {theirs / ours:.0f}")
    assert ours < theirs / 3


@each_filter
def test_one_track_is_no_slower_than_a_few_times_filterpy(method):
    """With the same model and Jacobian; ours checks its input, keeps every step and takes leading axes."""
    z = measurements(runs=1, steps=200)[0]
    ours = cost(lambda: track(PRIOR, MODEL, SENSOR, z, Q, method=method))
    theirs = cost(lambda: with_filterpy(method, z))
    print(f"\n{method.__name__}, one track: pendulab / filterpy = {ours / theirs:.2f}")
    assert ours < 4 * theirs


def test_scalar_path_is_quicker_than_the_array_path_for_one_state():
    x = np.array([1.0, 0.0, 0.8, 0.0])
    one = cost(lambda: [SYSTEM.f(x) for _ in range(2000)])
    many = cost(lambda: [SYSTEM.f(x[None]) for _ in range(2000)])
    print(f"\none state: scalar / array = {one / many:.2f}")
    assert one < many


def test_cached_code_costs_a_small_part_of_its_derivation(tmp_path, monkeypatch):
    """The reduced pendulum, the quickest to derive; what a second process pays against the first."""
    monkeypatch.setenv("PENDULAB_CACHE", str(tmp_path))
    system = systems.double_pendulum_reduced(0.5, 0.5, 10.0, 10.0)
    counts = (system.n, system.m, len(system.quantities))
    load = lambda write: codegen.load(system.name, system.sources, write, counts)  # noqa: E731
    derived = cost(lambda: load(lambda: system.derive().source()), repeat=1)
    cached = cost(lambda: load(None))
    print(f"\ncache / derivation = 1 / {derived / cached:.0f}")
    assert cached < derived / 10
