"""The matrices of an unsigned tutorial, as printed, and the roads and swings on which its filters are tried.

The replicas (`PRINTED`, `jacobian_1`, `input_jacobian_1`, `jacobian_2`, `Unwrapped`) are the document's;
everything else is the package's. Its letters: J and J_u are the book's F and G, τ is Δt, and φ is the heading
in question 1 and the pendulum's angle θ in question 2. `week8tutorial` makes records of all this.

Not printed, and chosen here: the sample period of question 1 (`TAU`), speed and road, the pose's start
("perfectly known": zero variances), the pendulum's start, its voltage, and how long one looks.
"""

from __future__ import annotations

import functools

import numpy as np

from .. import augment, consistency, discretize, input_noise, sensors, simulate, systems, track
from ..gaussian import Gaussian
from ..linalg import Array
from ..montecarlo import run

TAU, SPEED, STEPS = 0.1, 2.0, 400  # s, m/s: not printed
DRIVE = TAU * STEPS  # s
LANDMARK, SECOND = (20.0, 30.0), (60.0, -20.0)  # m; the second is ours
SHORT, LONG = 1.1, 1.3  # m, the range of L
PU = np.array([0.1, np.radians(1.0)]) ** 2  # of speed [m²/s²] and steering [rad²]
EYES = np.array([0.05, np.radians(2.0)]) ** 2  # of range [m²] and bearing [rad²]

A, C, DT = 10.0, 2.0, 0.005  # 1/s², rad/(s² V), s
TICK = 2 * np.pi / 4096  # rad, a step of the encoder
PU_VOLT = 0.05**2  # V²
B_LOW, B_HIGH, B_GUESS = 0.6, 0.8, 0.7  # 1/s

PRINTED = {
    "var_L": 0.15**2,  # m², for ±0.1 m
    "var_c": 0.15**2 / 1.2**4,  # 1/m², the last member of the printed chain
    "var_c, literally": 0.15**4 / 1.2**4,  # its second member, in which var_L stands twice
    "R": TICK**2,  # rad², a width as if it were a standard deviation
    "p33": 0.1**2,  # 1/s², the half-width of the range
}
HONEST = {  # what a uniform distribution of that width has
    "var_L": (LONG - SHORT) ** 2 / 12,
    "c": np.log(LONG / SHORT) / (LONG - SHORT),
    "R": TICK**2 / 12,
    "p33": (B_HIGH - B_LOW) ** 2 / 12,
}
HONEST["var_c"] = 1 / (SHORT * LONG) - HONEST["c"] ** 2
PRIORS = {  # of c, 1/m²
    "uniform": HONEST["var_c"],
    "printed": PRINTED["var_c"],
    "doubled": 2 * PRINTED["var_c"],
    "literal": PRINTED["var_c, literally"],
}
PRIORS_B = {"uniform": HONEST["p33"], "printed": PRINTED["p33"], "doubled": 2 * PRINTED["p33"]}


# ------------------------------------------------------------------------- the printed matrices


def jacobian_1(z: Array, u: Array, tau: float = TAU) -> Array:
    """J of question 1 (4, 4) at z = (x, y, φ, c) and u = (v, β), as printed. Right for Euler's step."""
    v, beta = u
    return np.array(
        [
            [1, 0, -tau * v * np.sin(z[2]), 0],
            [0, 1, tau * v * np.cos(z[2]), 0],
            [0, 0, 1, tau * v * np.tan(beta)],
            [0, 0, 0, 1],
        ]
    )


def input_jacobian_1(z: Array, u: Array, tau: float = TAU) -> Array:
    """J_u of question 1 (4, 2), as printed. Right for Euler's step."""
    v, beta = u
    return tau * np.array(
        [
            [np.cos(z[2]), 0],
            [np.sin(z[2]), 0],
            [z[3] * np.tan(beta), z[3] * v / np.cos(beta) ** 2],
            [0, 0],
        ]
    )


def jacobian_2(z: Array, tau: float = DT) -> Array:
    """J of question 2 (3, 3) at z = (φ, φ̇, b), as printed. Right for Euler's step.

    J_u is left to the reader of the document: (0, 2τ, 0)ᵀ.
    """
    return np.array(
        [[1, tau, 0], [-tau * 10 * np.cos(z[0]), 1 - z[2] * tau, -z[1] * tau], [0, 0, 1]], dtype=float
    )


class Unwrapped(sensors.RangeBearing):
    """Range and bearing whose innovations are plain differences: the document does not say that they wrap.

    Consequence: where the landmark is straight behind, a reading of −179° against a forecast of 179° is a
    surprise of 358°. Right: `sensors.range_bearing`, which knows what is an angle.
    """

    is_angle = property(lambda self: np.zeros(self.m, dtype=bool))


# ------------------------------------------------------------------------------ question 1, run


def eyes(landmarks=(LANDMARK,), R=EYES, n: int = 4):
    """The sensor of question 1 for these landmarks [m]."""
    return sensors.range_bearing(np.array(landmarks), R, n=n)


def weave(amplitude: float = 0.2, tau: float = TAU) -> Array:
    """Steering (DRIVE/tau,) in rad on a road with curves to both sides."""
    return amplitude * np.sin(0.3 * tau * np.arange(round(DRIVE / tau)))


def drive(rng, L, steering, landmarks=(LANDMARK,), R=EYES, offset=0.0, start=None, tau=TAU):
    """Truth (runs, DRIVE/tau, 3), readings, and the inputs as measured (runs, DRIVE/tau, 2).

    L (runs,) [m], steering broadcastable to (runs, DRIVE/tau) [rad]; the wheels stand at steering + offset.
    The truth is stepped by RK4. As the document says, the readings of speed and steering are noisy; the
    wheels do what they should.
    """
    us = np.empty((len(L), round(DRIVE / tau), 2))
    us[..., 0], us[..., 1] = SPEED, steering
    told = us + np.sqrt(PU) * rng.standard_normal(us.shape)
    start = np.zeros((len(L), 3)) if start is None else start
    world = discretize(systems.ackermann(L), tau)
    done, sensor = us + np.array([0.0, offset]), eyes(landmarks, R, n=3)
    truth, z = simulate(world, sensor, start, us.shape[1], 0, rng, us=done)
    return truth, z, told


def wheelbase_filter(z, told, var, sensor=None, guess=1 / 1.2, form="c", method="euler", pose=0.0, tau=TAU):
    """Track of (x, y, φ, c), or of (x, y, φ, L) with ``form="L"``, with Q = J_u P_u J_uᵀ at each estimate.

    var : variance of the parameter at the start, one or (runs,); guess : its mean; pose : covariance (3, 3)
    """
    if form == "c":
        system = augment(systems.ackermann_curvature(), curvature_scale=guess)
    else:
        system = augment(systems.ackermann(), wheelbase=guess)
    model = discretize(system, tau, method)
    P0 = np.zeros((*np.shape(var), 4, 4))
    P0[..., :3, :3], P0[..., 3, 3] = pose, var
    prior = Gaussian(np.broadcast_to([0.0, 0.0, 0.0, guess], P0.shape[:-1]), P0)
    return track(prior, model, sensor or eyes(), z, lambda model, x, u: input_noise(model, x, u, PU), us=told)


def ends(t, truth, value) -> dict[str, Array]:
    """Error, claim and squared relative error of the parameter, NEES of all states and of those before the
    parameter (three or two), mean NIS; each (runs,), at the end of a `Track`.
    """
    states = truth.shape[-1]
    last = np.concatenate([truth[:, -1], np.broadcast_to(value, truth.shape[:1])[:, None]], axis=-1)
    angle = np.arange(states + 1) == (2 if states == 3 else 0)
    mean, cov = t.mean[:, -1], t.cov[:, -1]
    error, claim = mean[:, -1] - value, t.std[:, -1, -1]
    return {
        "error": error,
        "claim": claim,
        "ratio": (error / claim) ** 2,
        "nees": consistency.nees(mean, cov, last, angle),
        "states": consistency.nees(mean[:, :states], cov[:, :states, :states], truth[:, -1], angle[:states]),
        "nis": t.nis.mean(axis=-1),
    }


def _named(name: str, values: dict[str, Array]) -> dict[str, Array]:
    return {f"{name} {key}": value for key, value in values.items()}


def _repeat(experiment, name: str, runs: int) -> dict[str, Array]:
    return run(experiment, runs, f"week8tutorial/{name}", block=50)


@functools.cache
def roads(runs: int) -> dict[str, Array]:
    """The weaving and the straight road, the landmark of the document, each prior of `PRIORS`.

    Keys "<road> <prior> <what>" with the what of `ends`; "early" is the squared relative error of c after
    1 s. Besides: "<road> right" with a better step and an honest prior, "weaving two", the same and a second
    landmark.
    """

    def experiment(rng, runs):
        L, out, honest = rng.uniform(SHORT, LONG, runs), {}, PRIORS["uniform"]
        for road, steering in (("weaving", weave()), ("straight", 0.0)):
            truth, z, told = drive(rng, L, steering)
            each = len(PRIORS)  # all priors at once, on the same data
            t = wheelbase_filter(
                np.tile(z, (each, 1, 1)), np.tile(told, (each, 1, 1)), np.repeat([*PRIORS.values()], runs)
            )
            found = ends(t, np.tile(truth, (each, 1, 1)), np.tile(1 / L, each))
            found["early"] = ((t.mean[:, 9, 3] - np.tile(1 / L, each)) / t.std[:, 9, 3]) ** 2
            for i, name in enumerate(PRIORS):
                own = slice(i * runs, (i + 1) * runs)
                out |= _named(f"{road} {name}", {key: value[own] for key, value in found.items()})
            right = wheelbase_filter(z, told, honest, guess=HONEST["c"], method="rk4")
            out |= _named(f"{road} right", ends(right, truth, 1 / L))
        places = (LANDMARK, SECOND)
        truth, z, told = drive(rng, L, weave(), places)
        both = wheelbase_filter(z, told, honest, eyes(places), guess=HONEST["c"], method="rk4")
        return out | _named("weaving two", ends(both, truth, 1 / L))

    return _repeat(experiment, "roads", runs)


PERIODS = (0.1, 0.2, 0.4)  # s, of sampling


@functools.cache
def periods(runs: int) -> dict[str, Array]:
    """Euler's step and RK4 on the weaving road for several τ: keys "<τ> <step> <what>" of `ends`, and "lead".

    "lead" is the least squares share of τφ̇/2 in the error of the heading: 1 if the filter's vehicle looks
    half a step ahead of the true one.
    """

    def experiment(rng, runs):
        out = {}
        for tau in PERIODS:
            L = rng.uniform(SHORT, LONG, runs)
            truth, z, told = drive(rng, L, weave(tau=tau), tau=tau)
            ahead = tau / 2 * SPEED / L[:, None] * np.tan(weave(tau=tau))
            for step in ("euler", "rk4"):
                t = wheelbase_filter(z, told, PRIORS["uniform"], method=step, tau=tau)
                out |= _named(f"{tau} {step}", ends(t, truth, 1 / L))
                off = t.mean[..., 2] - truth[..., 2]
                out[f"{tau} {step} lead"] = np.sum(off * ahead, axis=-1) / np.sum(ahead**2, axis=-1)
        return out

    return _repeat(experiment, "periods", runs)


HALF_WIDTHS = (0.1, 1.0)  # m, of the range of L about 1.2 m: the document's, and one of ours


@functools.cache
def forms(runs: int) -> dict[str, Array]:
    """c against L on the weaving road with the landmark of the document, uniform priors of several widths.

    Keys "<half-width> <form> kept", whether the parameter lies in the 95 % interval claimed after 3 s, and
    "... miss", the error of L [m] at the end.
    """

    def experiment(rng, runs):
        out = {}
        for half in HALF_WIDTHS:
            p, q = 1.2 - half, 1.2 + half
            L = rng.uniform(p, q, runs)
            _, z, told = drive(rng, L, weave())
            c0 = np.log(q / p) / (q - p)
            for form, guess, var in (("c", c0, 1 / (p * q) - c0**2), ("L", 1.2, half**2 / 3)):
                t = wheelbase_filter(z, told, var, guess=guess, form=form, method="rk4")
                value, found = (1 / L, 1 / t.mean[:, -1, 3]) if form == "c" else (L, t.mean[:, -1, 3])
                out[f"{half} {form} kept"] = np.abs(t.mean[:, 29, 3] - value) <= 1.96 * t.std[:, 29, 3]
                out[f"{half} {form} miss"] = np.abs(found - L)
        return out

    return _repeat(experiment, "forms", runs)


AMPLITUDES = (0.01, 0.02, 0.04, 0.08, 0.16)  # rad, of roads that weave
SHARP = np.array([0.001, 1e-4]) ** 2  # of range [m²] and bearing [rad²]: ours


def attenuation(amplitude: Array) -> Array:
    """s²/(s² + σ_β²) of a road that weaves by this [rad]: the share of c that sharp eyes find."""
    s2 = np.mean(np.tan(np.multiply.outer(amplitude, weave(1.0))) ** 2, axis=-1)
    return s2 / (s2 + PU[1])


@functools.cache
def gentle(runs: int) -> dict[str, Array]:
    """ĉ/c on roads of `AMPLITUDES` with two landmarks: (runs, amplitudes) for "sharp" eyes, and for the
    "printed" ones (runs, 2) on the first and the last of them.
    """

    def experiment(rng, runs):
        out, places = {}, (LANDMARK, SECOND)
        every = np.array(AMPLITUDES)
        for name, R, var, wide in (
            ("printed", EYES, PRIORS["printed"], every[[0, -1]]),
            ("sharp", SHARP, 0.3**2, every),
        ):
            L = rng.uniform(SHORT, LONG, (runs, len(wide)))
            waves = np.multiply.outer(wide, weave(1.0))
            steering = np.broadcast_to(waves, (runs, *waves.shape)).reshape(-1, STEPS)
            _, z, told = drive(rng, L.ravel(), steering, places, R)
            t = wheelbase_filter(z, told, var, eyes(places, R), method="rk4")
            out[name] = t.mean[:, -1, 3].reshape(L.shape) * L
        return out

    return _repeat(experiment, "gentle", runs)


TURN = 0.3  # rad, standard deviation of the turn about the landmark in `turned`


@functools.cache
def turned(runs: int) -> dict[str, Array]:
    """A start that is not known: the vehicle is turned about the landmark by an unknown angle of σ = TURN.

    With one landmark nothing in readings or inputs depends on that angle, so no filter may claim less than
    TURN for it, ever. Keys "<landmarks> claim" [rad] (of the angle, at the end), "... nees" (of all four).
    """

    def experiment(rng, runs):
        L, angle, out = rng.uniform(SHORT, LONG, runs), TURN * rng.standard_normal(runs), {}
        arm = -np.array(LANDMARK)  # from the landmark to the guessed start
        cos, sin = np.cos(angle), np.sin(angle)
        moved = np.stack([cos * arm[0] - sin * arm[1], sin * arm[0] + cos * arm[1]], axis=-1)
        start = np.column_stack([moved + LANDMARK, angle])
        hidden = np.array([-arm[1], arm[0], 1.0])
        pose = TURN**2 * np.outer(hidden, hidden) + np.diag([0.05, 0.05, 0.01]) ** 2
        for number, places in (("one", (LANDMARK,)), ("two", (LANDMARK, SECOND))):
            truth, z, told = drive(rng, L, weave(), places, start=start)
            t = wheelbase_filter(z, told, PRIORS["uniform"], eyes(places), pose=pose)
            out |= _named(number, ends(t, truth, 1 / L))
            out[f"{number} claim"] = t.std[:, -1, 2]
        return out

    return _repeat(experiment, "turned", runs)


@functools.cache
def circles(runs: int) -> dict[str, Array]:
    """β = 0.1 rad for ever, so that the landmark is once straight behind; and an offset of 1° in the wheel.

    Keys of `ends` behind "wrapped", "unwrapped", "offset" (circle of 0.2 rad) and "offset weaving"; "worst"
    is the largest NIS of a run.
    """

    def experiment(rng, runs):
        L, out = rng.uniform(SHORT, LONG, runs), {}
        truth, z, told = drive(rng, L, 0.1)
        right = eyes()
        fields = right.landmarks, right.R, right.position, right.heading, right.n
        for name, sensor in (("wrapped", right), ("unwrapped", Unwrapped(*fields))):
            t = wheelbase_filter(z, told, PRIORS["uniform"], sensor)
            out |= _named(name, ends(t, truth, 1 / L))
            out[f"{name} worst"] = t.nis.max(axis=-1)
        for name, steering in (("offset", 0.2), ("offset weaving", weave())):
            truth, z, told = drive(rng, L, steering, offset=np.radians(1.0))
            t = wheelbase_filter(z, told, PRIORS["uniform"])
            out |= _named(name, ends(t, truth, 1 / L))
        return out

    return _repeat(experiment, "circles", runs)


# ------------------------------------------------------------------------------ question 2, run


def swing(rng, b, x0, steps, volts=None, encoder=sensors.rounding_encoder):
    """Truth (..., steps, 2), readings of a real encoder, and voltages as measured (..., steps, 1).

    b (...,), x0 (..., 2), volts (..., steps) or None for none. The truth is stepped by RK4.
    """
    world = discretize(systems.driven_pendulum(A, b, C), DT)
    us = np.zeros((*np.shape(b), steps, 1)) if volts is None else volts[..., None]
    truth, z = simulate(world, encoder(world, ["theta"], step=TICK), x0, steps, 0, rng, us=us)
    return truth, z, us + np.sqrt(PU_VOLT) * rng.standard_normal(us.shape)


def friction_filter(z, told, x0, var=HONEST["p33"], R=HONEST["R"], method="rk4", start=(0.001, 0.1)):
    """Track of (θ, ω, b) with Q = J_u P_u J_uᵀ.

    var : variance of b; R : of a reading; start : deviations of θ [rad] and ω [rad/s], for which the document
    has dots: who lets go of a pendulum knows them
    """
    augmented = augment(systems.driven_pendulum(A, B_GUESS, C), b=B_GUESS)
    model = discretize(augmented, DT, method)
    prior = Gaussian(augmented.start(x0), [start[0] ** 2, start[1] ** 2, var])
    Q = input_noise(model, [0.0, 0.0, B_GUESS], None, PU_VOLT)
    return track(prior, model, sensors.components(model, ["theta"], R=R), z, Q, us=told)


RELEASES = (0.3, 1.0, 2.0, 2.8)  # rad, from rest
VARIANTS = {  # how a filter differs from the one done right
    "printed": dict(method="euler", R=PRINTED["R"], var=PRINTED["p33"]),
    "printed, p33 doubled": dict(method="euler", R=PRINTED["R"], var=2 * PRINTED["p33"]),
    "printed, R right": dict(method="euler", var=PRINTED["p33"]),
    "printed, p33 right": dict(method="euler", R=PRINTED["R"]),
    "printed, R and step right": dict(var=PRINTED["p33"]),
    "printed, step right": dict(R=PRINTED["R"], var=PRINTED["p33"]),
    "right": {},
}


def _flat(values: Array, like: Array) -> Array:
    return values.reshape(*like.shape, *values.shape[1:])


@functools.cache
def swings(runs: int) -> dict[str, Array]:
    """Free swings of 10 s from `RELEASES`, each filter of `VARIANTS`: keys "<variant> <what>" of `ends`,
    (runs, releases); "foretold" is aτ⟨ω² cos θ⟩/⟨ω²⟩ along the true swings.
    """

    def experiment(rng, runs):
        b = rng.uniform(B_LOW, B_HIGH, (runs, len(RELEASES)))
        x0 = np.stack(np.broadcast_arrays(RELEASES, 0 * b), axis=-1).reshape(-1, 2)
        truth, z, told = swing(rng, b.ravel(), x0, 2000)
        squares = truth[..., 1] ** 2
        foretold = A * DT * np.sum(squares * np.cos(truth[..., 0]), axis=-1) / np.sum(squares, axis=-1)
        out = {"foretold": _flat(foretold, b)}
        for name, options in VARIANTS.items():
            found = ends(friction_filter(z, told, x0, **options), truth, b.ravel())
            out |= _named(name, {key: _flat(value, b) for key, value in found.items()})
        return out

    return _repeat(experiment, "swings", runs)


PACES = (2.0, np.sqrt(A), 5.0, 8.0)  # rad/s, of the voltage


def _steady(rng, b, amplitude, nu, steps):
    """A pendulum that has swung for long: x0 (..., 2) and volts (..., steps) for small amplitudes [rad]."""
    phase = rng.uniform(0, 2 * np.pi, b.shape)
    response = C / (A - nu**2 + 1j * b * nu)  # rad/V
    push = amplitude / np.abs(response)
    lag = np.angle(response)
    x0 = np.stack([amplitude * np.sin(phase + lag), amplitude * nu * np.cos(phase + lag)], axis=-1)
    now = np.multiply.outer(np.broadcast_to(nu, b.shape), DT * np.arange(steps))
    return x0, push[..., None] * np.sin(now + phase[..., None])


@functools.cache
def driven(runs: int) -> dict[str, Array]:
    """A voltage that keeps up a swing of 0.3 rad at each of `PACES`: keys "<step> <what>" (runs, paces)."""

    def experiment(rng, runs):
        b, out = rng.uniform(B_LOW, B_HIGH, (runs, len(PACES))), {}
        x0, volts = _steady(rng, b, 0.3, np.array(PACES), 2000)
        truth, z, told = (_joined(v) for v in swing(rng, b, x0, 2000, volts))
        for method in ("euler", "rk4"):
            t = friction_filter(z, told, _joined(x0), PRINTED["p33"], method=method)
            found = ends(t, truth, b.ravel())
            out |= _named(method, {key: _flat(value, b) for key, value in found.items()})
        return out

    return _repeat(experiment, "driven", runs)


def _joined(values: Array) -> Array:
    """(runs, cases, ...) as (runs · cases, ...)."""
    return values.reshape(-1, *values.shape[2:])


TICKS = (1.4, 40.0, 200.0)  # amplitudes in steps of the encoder
ENCODERS = {"rounds": sensors.rounding_encoder, "floors": sensors.flooring_encoder}


@functools.cache
def ticks(runs: int) -> dict[str, Array]:
    """Shaken at resonance for 20 s with amplitudes of `TICKS`, read by encoders that round or floor.

    Keys "<encoder> <R> <what>", (runs, sizes), R "q²" or "q²/12"; "<encoder> white" is the autocorrelation of
    the encoder's error from one reading to the next, and "<encoder> variance" its mean square, in q²/12.
    """

    def experiment(rng, runs):
        b, out = rng.uniform(B_LOW, B_HIGH, (runs, len(TICKS))), {}
        x0, volts = _steady(rng, b, TICK * np.array(TICKS), np.sqrt(A), 4000)
        for name, encoder in ENCODERS.items():
            truth, z, told = (_joined(v) for v in swing(rng, b, x0, 4000, volts, encoder))
            error = (z - truth[..., :1])[..., 0]
            spread = np.mean(error**2, axis=-1)
            out[f"{name} variance"] = _flat(spread / HONEST["R"], b)
            neighbours = np.mean(error[:, 1:] * error[:, :-1], axis=-1)
            out[f"{name} white"] = _flat(neighbours / spread, b)
            for label, R in (("q²", PRINTED["R"]), ("q²/12", HONEST["R"])):
                found = ends(friction_filter(z, told, _joined(x0), R=R), truth, b.ravel())
                out |= _named(f"{name} {label}", {k: _flat(v, b) for k, v in found.items()})
        return out

    return _repeat(experiment, "ticks", runs)


@functools.cache
def rest(runs: int) -> dict[str, Array]:
    """10 s of a pendulum that hangs still: the rise of b̂ and its claim at the end, (runs,).

    Keys "<prior> q²/12 rise" and "... claim" for priors of `PRIORS_B`, and "printed q² ...".
    """

    def experiment(rng, runs):
        out, still = {}, np.zeros((runs, 2))
        _, z, told = swing(rng, np.full(runs, B_GUESS), still, 2000)
        cases = [(prior, "q²/12", HONEST["R"]) for prior in PRIORS_B]
        for prior, label, R in (*cases, ("printed", "q²", PRINTED["R"])):
            t = friction_filter(z, told, still, PRIORS_B[prior], R)
            out[f"{prior} {label} rise"] = t.mean[:, -1, 2] - B_GUESS
            out[f"{prior} {label} claim"] = t.std[:, -1, 2]
        return out

    return _repeat(experiment, "rest", runs)
