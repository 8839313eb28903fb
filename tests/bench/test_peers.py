"""Who is timed against each other must do the same work: every competitor comes to the same result.

filterpy agrees to rounding. dynamax adds 1e-9 to the diagonal of the innovation covariance before it solves
for a gain; without that it agrees to rounding too.
"""

import cold
import numpy as np
import peers
import pytest

PEERS = {"filterpy": (peers.filterpy, 1e-9)}
if peers.HAS_DYNAMAX:
    PEERS |= {
        "dynamax": (peers.dynamax, 1e-6),
        "dynamax without its diagonal boost": (lambda *it: peers.dynamax(*it, boost=0.0), 1e-9),
    }
each_peer = pytest.mark.parametrize("peer", PEERS)
each_method = pytest.mark.parametrize("method", peers.METHODS)


@each_peer
@each_method
def test_peers_come_to_the_same_beliefs(method, peer):
    run, tolerance = PEERS[peer]
    z = peers.measurements(300)
    mean, cov = peers.pendulab(method, z)
    means, covs = run(method, z)
    np.testing.assert_allclose(means, mean, rtol=0, atol=tolerance)
    np.testing.assert_allclose(covs, cov, rtol=0, atol=tolerance * np.abs(cov).max() * 10)


@each_peer
@each_method
def test_many_tracks_at_once_are_the_same_tracks(method, peer):
    run, tolerance = PEERS[peer]
    z = peers.measurements(20, runs=30)
    mean, cov = peers.pendulab(method, z)
    means, covs = one_by_one(run, method, z) if peer == "filterpy" else run(method, z)
    np.testing.assert_allclose(means, mean, rtol=0, atol=tolerance)
    np.testing.assert_allclose(covs, cov, rtol=0, atol=tolerance * np.abs(cov).max() * 10)


def one_by_one(run, method, z):
    results = [run(method, one) for one in z]
    return np.stack([mean for mean, _ in results]), np.stack([cov for _, cov in results])


def test_physics_that_a_peer_types_is_the_physics_that_we_derive():
    derived, rates = peers.derived("math", jacobian=True), peers.derived("math")
    for x in np.random.default_rng(3).uniform(-2, 2, (20, 4)):
        np.testing.assert_allclose(cold.linearised(*x), derived(*x), rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(cold.rates(*x), rates(*x), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(cold.noise(), peers.Q, rtol=1e-12)


def test_model_that_filterpy_is_given_is_ours():
    step, tangent = peers.filterpy_model()
    for x in np.random.default_rng(4).uniform(-2, 2, (20, 4)):
        ahead, F = tangent(x)
        np.testing.assert_allclose(step(x), peers.MODEL.step(x), rtol=0, atol=1e-13)
        np.testing.assert_allclose(ahead, peers.MODEL.step(x), rtol=0, atol=1e-13)
        np.testing.assert_allclose(F, peers.MODEL.jacobian(x), rtol=0, atol=1e-13)
