"""From one unit to another, where both are written in SI symbols that leave no doubt."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from invtrack.arrays import Array

PREFIXES = {"n": -9, "u": -6, "µ": -6, "μ": -6, "m": -3, "c": -2, "k": 3, "M": 6, "G": 9}

PREFIXED = ("m", "g", "s", "rad", "N", "Pa", "J", "W", "V", "A", "Hz", "T")

SPELLED = {
    "sec": "s",
    "second": "s",
    "seconds": "s",
    "metre": "m",
    "metres": "m",
    "meter": "m",
    "meters": "m",
    "radian": "rad",
    "radians": "rad",
    "°": "deg",
    "degree": "deg",
    "degrees": "deg",
    "Nm": "N m",
    "rpm": "rev/min",
}


@dataclass(frozen=True)
class Factor:
    """ratio pi^pi_power: what a number in one unit is multiplied with to be in another."""

    ratio: Fraction
    pi_power: int

    def applied(self, values: Array) -> Array:
        """The values in the other unit, rounded once where no pi is in the way."""
        return np.asarray(values * float(self.ratio.numerator) / float(self.ratio.denominator) * np.pi**self.pi_power)


@dataclass(frozen=True)
class _Unit:
    """ratio pi^pi_power times powers of base symbols."""

    ratio: Fraction
    pi_power: int
    powers: dict[str, int]

    def times(self, other: _Unit, power: int) -> _Unit:
        powers = Counter(self.powers)
        for symbol, exponent in other.powers.items():
            powers[symbol] += power * exponent
        kept = {symbol: exponent for symbol, exponent in powers.items() if exponent}
        return _Unit(self.ratio * other.ratio**power, self.pi_power + power * other.pi_power, kept)


_ONE = _Unit(Fraction(1), 0, {})
_SYMBOLS = {
    "1": _ONE,
    "%": _Unit(Fraction(1, 100), 0, {}),
    "min": _Unit(Fraction(60), 0, {"s": 1}),
    "h": _Unit(Fraction(3600), 0, {"s": 1}),
    "deg": _Unit(Fraction(1, 180), 1, {"rad": 1}),
    "rev": _Unit(Fraction(2), 1, {"rad": 1}),
}


def conversion(unit: str, to: str) -> Factor | None:
    """The factor from a unit to another one: "mm" to "m", "deg/s" to "rad/s", "N" to "x10 N"; None where that is not certain.

    Newton metres are no joules here, nor hertz radians per second: what equal dimensions mean is for people to say.
    """
    if unit == to:
        return Factor(Fraction(1), 0)
    given, wanted = _parsed(unit), _parsed(to)
    if given is None or wanted is None or given.powers != wanted.powers:
        return None
    return Factor(given.ratio / wanted.ratio, given.pi_power - wanted.pi_power)


def is_unit(text: str) -> bool:
    """Whether a text is a unit and nothing else."""
    return _parsed(text) is not None


def _parsed(text: str) -> _Unit | None:
    """Products and quotients of symbols with powers, such as "kg m^2/s"; of a multiple too, "x10 N"."""
    multiple = re.fullmatch(r"x(\d+(?:\.\d+)?(?:[eE][-+]?\d+)?) (.+)", text)
    unit = _Unit(Fraction(multiple[1]), 0, {}) if multiple else _ONE
    for number, part in enumerate((multiple[2] if multiple else text).split("/")):
        for word in re.split(r"[\s·⋅*]+", part.strip()):
            factor = _power(word)
            if factor is None:
                return None
            unit = unit.times(factor, 1 if number == 0 else -1)
    return unit if unit.ratio else None


def _power(word: str) -> _Unit | None:
    """A symbol with or without its power: "m", "s^2", "s²", "s^-1"."""
    found = re.fullmatch(r"(1|[^\d^²³-]+)(?:\^(-?\d)|([²³]))?", word)
    if found is None:
        return None
    power = int(found[2]) if found[2] else {"²": 2, "³": 3}.get(found[3] or "", 1)
    spelled = SPELLED.get(found[1])
    unit = _symbol(found[1]) if spelled is None else _parsed(spelled)
    return None if unit is None else _ONE.times(unit, power)


def _symbol(text: str) -> _Unit | None:
    if text in _SYMBOLS:
        return _SYMBOLS[text]
    if text in PREFIXED:
        return _Unit(Fraction(1), 0, {text: 1})
    if text[:1] in PREFIXES and text[1:] in PREFIXED and (text[0] != "c" or text[1:] == "m"):
        return _Unit(Fraction(10) ** PREFIXES[text[0]], 0, {text[1:]: 1})
    return None
