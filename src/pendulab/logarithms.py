"""Parameters that cannot be negative, by their logarithms: every real number is then a possible one.

A Gaussian belief about a length has a tail below zero, and an update may land there. The same belief about
its logarithm is one about ratios, and no value of it is impossible.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .linalg import Array
from .system import Derivation, Quantity, System, unknown_name

_PREFIX = "log_"


@dataclass(frozen=True)
class _Substitute:
    """The derivation of a system, with p = exp(log_p) for some of its parameters."""

    derive: Callable[[], Derivation]
    positions: tuple[int, ...]  # of the parameters, in the system's own order

    def __call__(self) -> Derivation:
        import sympy as sp

        d = self.derive()
        parameters, told = list(d.parameters), {}
        for i in self.positions:
            log = sp.Symbol(_PREFIX + d.parameters[i].name, real=True)
            parameters[i], told[d.parameters[i]] = log, sp.exp(log)
        energy = d.mechanics.energy if d.mechanics else d.energy
        energy = None if energy is None else energy.subs(told)
        return Derivation(d.states, d.inputs, tuple(parameters), d.flow.subs(told), energy=energy)


@dataclass(frozen=True)
class _Refuse:
    """What the parameters themselves must obey together."""

    refuse: Callable[[Mapping[str, float | Array]], None]
    names: tuple[str, ...]

    def __call__(self, parameters: Mapping[str, float | Array]) -> None:
        logs = {_PREFIX + name: name for name in self.names}
        self.refuse({logs.get(k, k): np.exp(v) if k in logs else v for k, v in parameters.items()})


def in_logarithms(system: System, *names: str) -> System:
    """The same physics, told the natural logarithms of some parameters: ``length`` becomes ``log_length``.

    Book: eq-logarithm. For parameters that cannot be negative. `augment` may then make states of them. A
    standard deviation of log_length is a relative one: 0.1 means about a tenth. The energy stays; the
    Lagrangian is that of the system it came from.

    Parameters
    ----------
    system : any system that has these parameters, before `augment`
    names : of parameters whose range begins at zero or above

    Raises
    ------
    KeyError : unknown name; the message gives the nearest known one
    ValueError : no name, a parameter that may be negative, or one that is zero now

    Examples
    --------
    >>> from pendulab import systems
    >>> pendulum = in_logarithms(systems.simple_pendulum(length=2.0), "length")
    >>> round(float(pendulum.parameters["log_length"]), 4)
    0.6931
    """
    if not names:
        raise ValueError(f"in_logarithms: expected at least one parameter of {system.name}")
    known = [q.name for q in system.quantities]
    quantities, parameters = list(system.quantities), dict(system.parameters)
    for name in names:
        if name not in known:
            raise KeyError(unknown_name("parameter", name, known, system.name))
        i = known.index(name)
        value = np.asarray(parameters.pop(name), dtype=float)
        if quantities[i].low < 0:
            raise ValueError(f"{name}: it may be negative, and then it has no logarithm")
        if not (value > 0).all():
            raise ValueError(f"{name}: expected a positive number, got {value.min():g}")
        quantities[i] = Quantity(_PREFIX + name, "1")
        parameters[_PREFIX + name] = np.log(value)
    return System(
        name=f"{system.name}+log+{'+'.join(names)}",
        states=system.states,
        inputs=system.inputs,
        quantities=tuple(quantities),
        parameters=parameters,
        derive=_Substitute(system.derive, tuple(known.index(name) for name in names)),
        sources=(*system.sources, Path(__file__)),
        velocity_of=system.velocity_of,
        refuse=_Refuse(system.refuse, tuple(names)),
    )
