"""The people to bake: shape parameters of anny and the stature they shall have."""

# gender 0 = male, 1 = female; age 1/3 = child, 2/3 = young adult, 1 = old; the others 0 to 1.
# The height parameter follows from the stature [m] without shoes.
PEOPLE: dict[str, dict[str, float]] = {
    "adam": {"stature_m": 1.80, "gender": 0.0, "age": 0.68, "muscle": 0.52, "weight": 0.50},
    "bea": {"stature_m": 1.67, "gender": 1.0, "age": 0.68, "muscle": 0.52, "weight": 0.45},
    "carlos": {"stature_m": 1.73, "gender": 0.0, "age": 0.78, "muscle": 0.50, "weight": 0.80},
    "dana": {"stature_m": 1.60, "gender": 1.0, "age": 0.72, "muscle": 0.48, "weight": 0.58},
    "erik": {"stature_m": 1.94, "gender": 0.0, "age": 0.66, "muscle": 0.48, "weight": 0.38},
    "fumiko": {"stature_m": 1.54, "gender": 1.0, "age": 0.96, "muscle": 0.38, "weight": 0.50},
    "george": {"stature_m": 1.72, "gender": 0.0, "age": 0.97, "muscle": 0.42, "weight": 0.58},
    "hana": {"stature_m": 1.58, "gender": 1.0, "age": 0.53, "muscle": 0.48, "weight": 0.40},
    "ivo": {"stature_m": 1.45, "gender": 0.0, "age": 0.40, "muscle": 0.50, "weight": 0.45},
    "joy": {"stature_m": 1.70, "gender": 1.0, "age": 0.74, "muscle": 0.48, "weight": 0.82},
    "twin_a": {"stature_m": 1.78, "gender": 0.0, "age": 0.64, "muscle": 0.48, "weight": 0.46},
    "twin_b": {"stature_m": 1.77, "gender": 0.0, "age": 0.65, "muscle": 0.50, "weight": 0.49},
}
