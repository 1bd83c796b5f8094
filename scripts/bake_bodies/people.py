"""Baked people: shape parameters of anny and stature."""

from typing import NamedTuple


class Shape(NamedTuple):
    """Parameters of a body, 0 to 1 except the stature.

    Args:
        stature_m: Without shoes, in metres; anny's height parameter follows from it.
        gender: 0 = male, 1 = female.
        age: 0 = 1 year, 1/3 = 10 years, 2/3 = 25 years, 1 = old.
        muscle: 0.5 = average.
        weight: 0.5 = average.
        proportions: 0 = broad shoulders and long legs, 1 = anny's ideal.
    """

    stature_m: float
    gender: float
    age: float
    muscle: float
    weight: float
    proportions: float


PEOPLE = {
    "adam": Shape(1.80, 0.0, 0.68, 0.52, 0.50, 0.74),
    "bea": Shape(1.67, 1.0, 0.68, 0.52, 0.45, 0.50),
    "carlos": Shape(1.73, 0.0, 0.78, 0.50, 0.80, 0.70),
    "dana": Shape(1.60, 1.0, 0.72, 0.48, 0.58, 0.50),
    "erik": Shape(1.94, 0.0, 0.66, 0.48, 0.38, 0.82),
    "fumiko": Shape(1.54, 1.0, 0.96, 0.38, 0.50, 0.50),
    "george": Shape(1.72, 0.0, 0.97, 0.42, 0.58, 0.72),
    "hana": Shape(1.58, 1.0, 0.53, 0.48, 0.40, 0.50),
    "ivo": Shape(1.45, 0.0, 0.40, 0.50, 0.45, 0.65),
    "joy": Shape(1.70, 1.0, 0.74, 0.48, 0.82, 0.50),
    "twin_a": Shape(1.78, 0.0, 0.64, 0.48, 0.46, 0.76),
    "twin_b": Shape(1.77, 0.0, 0.65, 0.50, 0.49, 0.76),
    # Median statures at 3, 5 and 8 years [WHO 2006]
    "kim": Shape(0.96, 1.0, 0.074, 0.50, 0.50, 0.50),
    "leo": Shape(1.10, 0.0, 0.148, 0.50, 0.50, 0.50),
    "mia": Shape(1.27, 1.0, 0.259, 0.50, 0.48, 0.50),
}
