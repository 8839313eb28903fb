"""dynamax, an independent implementation on JAX. Needs the environment of `make peers`. No pendulab in here.

One thread and double precision, as everybody else here; the threads must be said before JAX is imported.
dynamax keeps other conventions, and three matter:

- its prior is the belief at the time of the first measurement, so it is given ours moved one step ahead;
- ``alpha``, ``beta`` and ``kappa`` mean what `sigma_points.scaled` means by them, and its UKF draws its
  points anew before the measurement, as ours does; but its defaults are √3, 2, 1 and not 1, 2, 0;
- before it solves for a gain, it adds `DIAGONAL_BOOST` to the diagonal of the innovation covariance.

It takes plain differences of angles, so it agrees with ours only while none is wrapped.
"""

import os

os.environ["NPROC"] = "1"  # XLA's pool of threads; the two flags below leave it as it is
os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
os.environ["JAX_PLATFORMS"] = "cpu"

import jax
import jax.numpy as jnp
import numpy as np
from dynamax.nonlinear_gaussian_ssm import (
    ParamsNLGSSM,
    UKFHyperParams,
    extended_kalman_filter,
    unscented_kalman_filter,
)
from dynamax.utils.utils import psd_solve

jax.config.update("jax_enable_x64", True)

DIAGONAL_BOOST = 1e-9  # the default of its psd_solve
FIELDS = ["filtered_means", "filtered_covariances", "predicted_means", "predicted_covariances"]


def rk4(rates, dt):
    """One step of ``rates(a, b, c, d)``, four arrays in jax.numpy; dynamax differentiates it by itself."""

    def rate(x):
        return jnp.stack(rates(*x))

    def step(x):
        k1 = rate(x)
        k2 = rate(x + dt / 2 * k1)
        k3 = rate(x + dt / 2 * k2)
        k4 = rate(x + dt * k3)
        return x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)

    return step


def compiled(method, step, mean, cov, Q, R, many=False, boost=DIAGONAL_BOOST):
    """Means and covariances as a function of measurements (steps, 4), or (runs, steps, 4) if many; the
    first call compiles it. Mean and cov are the belief at the time of the first measurement."""
    params = ParamsNLGSSM(
        initial_mean=jnp.array(mean),
        initial_covariance=jnp.array(cov),
        dynamics_function=step,
        dynamics_covariance=jnp.array(Q),
        emission_function=lambda x: x,
        emission_covariance=jnp.array(R),
    )

    def one(z):
        psd_solve.__defaults__ = (boost,)  # read now, while this is compiled
        if method == "ekf":
            return extended_kalman_filter(params, z, output_fields=FIELDS)
        return unscented_kalman_filter(params, z, UKFHyperParams(1.0, 2.0, 0.0), output_fields=FIELDS)

    run = jax.jit(jax.vmap(one) if many else one)

    def to_numpy(z):
        found = jax.block_until_ready(run(z))
        return np.asarray(found.filtered_means), np.asarray(found.filtered_covariances)

    return to_numpy
