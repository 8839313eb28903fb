"""Unknown parameters as extra states: what a filter cannot be told, it may estimate.

A parameter that is constant has the rate zero. What makes it observable is the flow: SymPy differentiates
it by the parameter like by any other state, and the filter learns the covariance of both.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .discretize import Model
from .linalg import Array
from .system import Derivation, System, refuse_outside_range, unknown_name


@dataclass(frozen=True)
class _Derive:
    """The derivation of a system, with some of its parameters moved among its states.

    Equal for equal systems and names, so that a process derives each augmented system once.
    """

    derive: Callable[[], Derivation]
    positions: tuple[int, ...]  # of the parameters, in the system's own order

    def __call__(self) -> Derivation:
        import sympy as sp

        d = self.derive()
        moved = tuple(d.parameters[i] for i in self.positions)
        kept = tuple(p for p in d.parameters if p not in moved)
        flow = d.flow.col_join(sp.zeros(len(moved), 1))
        return Derivation((*d.states, *moved), d.inputs, kept, flow, d.mechanics, d.energy)


@dataclass(frozen=True)
class _Refuse:
    """What parameters must obey together, asked with the first guesses in place of those that are states."""

    refuse: Callable[[Mapping[str, float | Array]], None]
    guesses: Mapping[str, float | Array]

    def __call__(self, parameters: Mapping[str, float | Array]) -> None:
        self.refuse({**parameters, **self.guesses})


@dataclass(frozen=True, eq=False)
class AugmentedSystem(System):
    """A `System` some of whose states are parameters of another. Made by `augment`.

    Attributes
    ----------
    nominal : the first guesses of these parameters, by name
    """

    nominal: Mapping[str, float | Array] = field(default_factory=dict)

    def start(self, x: Array) -> Array:
        """States (..., n) from those of the system without its parameters: the nominal values appended.

        >>> from pendulab import systems
        >>> augment(systems.driven_pendulum(), b=0.7).start([1.0, 0.0])
        array([1. , 0. , 0.7])
        """
        x, values = np.asarray(x, dtype=float), [np.asarray(v, dtype=float) for v in self.nominal.values()]
        if x.shape[-1:] != (self.n - len(values),):
            names = self.state_names[: self.n - len(values)]
            raise ValueError(f"x: expected states of shape (..., {len(names)}) = {names}, got {x.shape}")
        lead = np.broadcast_shapes(x.shape[:-1], *(v.shape for v in values))
        columns = [np.broadcast_to(v, lead)[..., None] for v in values]
        return np.concatenate([np.broadcast_to(x, (*lead, x.shape[-1])), *columns], axis=-1)


def augment(system: System, **parameters: float | Array) -> AugmentedSystem:
    """Turn parameters of a system into states with the rate zero, behind its own states and in this order.

    Names, units, angles and ranges are kept. The ranges are information: a filter is free to leave them, as
    a Gaussian always is. The other parameters stay what they were, runs included, and `velocity_of`, the
    input and the energy (with the state's value of the parameter) go with them. Parameters do not change on
    their own; let one wander by adding `parameter_walk` to Q.

    Parameters
    ----------
    system : any system; one that is augmented already may get further parameters
    parameters : name and first guess of each, in its unit and range; a first guess (...) for each run is
        allowed. `AugmentedSystem.start` puts the guesses into a state, the prior says how good they are

    Raises
    ------
    KeyError : unknown name; the message gives the nearest known one
    ValueError : no name, a name that is a state already, or a guess outside the parameter's range

    Examples
    --------
    >>> from pendulab import systems
    >>> augmented = augment(systems.driven_pendulum(), b=0.7)
    >>> augmented.state_names, augmented.state_units
    (('theta', 'omega', 'b'), ('rad', 'rad/s', '1/s'))
    >>> augmented.jacobian_x([0.0, 2.0, 0.7])[1].tolist()  # by theta, omega and b
    [-10.0, -0.7, -2.0]
    """
    if not parameters:
        raise ValueError(f"augment: expected at least one parameter of {system.name}: name=first_guess")
    names = [q.name for q in system.quantities]
    for name in parameters:
        if name in system.state_names:
            raise ValueError(f"{name!r} is a state of {system.name} already")
        if name not in names:
            raise KeyError(unknown_name("parameter", name, names, system.name))
    moved = [system.quantities[names.index(name)] for name in parameters]
    nominal = {**getattr(system, "nominal", {}), **parameters}
    for quantity in moved:
        refuse_outside_range(system.name, quantity, parameters[quantity.name])

    return AugmentedSystem(
        name=f"{system.name}+{'+'.join(parameters)}",
        states=(*system.states, *moved),
        inputs=system.inputs,
        quantities=tuple(q for q in system.quantities if q.name not in parameters),
        parameters={k: v for k, v in system.parameters.items() if k not in parameters},
        derive=_Derive(system.derive, tuple(names.index(name) for name in parameters)),
        sources=(*system.sources, Path(__file__)),
        velocity_of=system.velocity_of,
        refuse=_Refuse(system.refuse, parameters),
        nominal=nominal,
    )


def parameter_walk(model: Model, **intensity: float | Array) -> Array:
    """Q of one step (..., n, n) when parameters wander: intensity times dt on their variances, else zero.

    A parameter driven by white noise of intensity q has variance q t after t seconds: √q is what it moves,
    typically, in one second. Add the result to the Q of the other states. What the walk does to the other
    states within the same step is left out: covariances of order q dt². `van_loan` has them.

    Parameters
    ----------
    model : of a system made by `augment`
    intensity : q of each parameter that wanders, by name, in its unit² per second; (...) for runs

    Raises
    ------
    ValueError : the system is not augmented, or an intensity is negative or not finite
    KeyError : a name is none of the parameters among the states; the message gives the nearest one

    Examples
    --------
    >>> from pendulab import discretize, systems
    >>> model = discretize(augment(systems.driven_pendulum(), b=0.7), dt=0.01)
    >>> parameter_walk(model, b=0.5**2).diagonal().tolist()
    [0.0, 0.0, 0.0025]
    """
    system = model.system
    if not isinstance(system, AugmentedSystem):
        raise ValueError(
            f"parameter_walk needs a system with parameters as states, and {system.name} has none"
        )
    for name, value in intensity.items():
        if name not in system.nominal:
            raise KeyError(
                unknown_name("parameter among its states", name, tuple(system.nominal), system.name)
            )
        q = np.asarray(value, dtype=float)
        if not (np.isfinite(q).all() and (q >= 0).all()):
            raise ValueError(f"{name}: expected a non-negative intensity, got {value!r}")
    lead = np.broadcast_shapes(*(np.shape(q) for q in intensity.values()))
    Q = np.zeros((*lead, model.n, model.n))
    for name, q in intensity.items():
        Q[..., system.index(name), system.index(name)] = np.asarray(q) * model.dt
    return Q
