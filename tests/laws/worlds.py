"""Small worlds on which the laws are checked."""

from dataclasses import dataclass

import numpy as np

from pendulab import Gaussian, LinearModel, discretize, sensors, simulate, stream, systems, white_acceleration


@dataclass
class World:
    """Everything that `track` takes, with the truth."""

    prior: Gaussian
    model: object
    sensor: object
    Q: np.ndarray
    truth: np.ndarray
    z: np.ndarray
    us: np.ndarray | None = None

    @property
    def arguments(self):
        return dict(prior=self.prior, model=self.model, sensor=self.sensor, z=self.z, Q=self.Q, us=self.us)


def random_covariance(rng, n):
    """Full, well conditioned, with eigenvalues between about 0.1 and 5."""
    A = rng.standard_normal((n, n))
    return A @ A.T / n + 0.1 * np.eye(n)


def linear_world(name, n=4, m=2, inputs=1, steps=200):
    """A random stable linear model with full Q and R, of which fewer components are measured than there
    are."""
    rng = stream(name)
    F = rng.standard_normal((n, n))
    F *= 0.97 / np.abs(np.linalg.eigvals(F)).max()
    model = LinearModel(F, rng.standard_normal((n, inputs)))
    sensor = sensors.linear(rng.standard_normal((m, n)), random_covariance(rng, m))
    prior, Q = Gaussian(rng.standard_normal(n), random_covariance(rng, n)), random_covariance(rng, n)
    us = rng.standard_normal((steps, inputs))
    truth, z = simulate(model, sensor, prior, steps, Q, rng, us)
    return World(prior, model, sensor, Q, truth, z, us)


def with_gaps(z, name, fraction=0.3):
    """Each component missing now and then, some measurements missing altogether."""
    rng = stream(name)
    z = np.where(rng.random(z.shape) < fraction, np.nan, z)
    z[..., ::17, :] = np.nan
    return z


def pendulum_world(name, runs=None, steps=200, measured=("theta1", "theta2"), intensity=0.01, std=0.02):
    """A double pendulum that swings at 60°, filmed 100 times a second: nonlinear, and regular enough to
    be known."""
    rng = stream(name)
    system = systems.double_pendulum(b1=0.05, b2=0.05)
    model, sensor = discretize(system, 0.01), sensors.components(system, measured, std**2)
    prior = Gaussian([1.0, 0.0, 0.8, 0.0], np.array([0.05, 0.1, 0.05, 0.1]) ** 2)
    Q = white_acceleration(model, intensity)
    truth, z = simulate(model, sensor, prior, steps, Q, rng, runs=runs)
    return World(prior, model, sensor, Q, truth, z)
