"""Literature that defines the gait parameters; formulas are in docs/method.md, section 20."""

from collections.abc import Mapping

REFERENCES: Mapping[str, str] = {
    "Perry 2010": (
        "J. Perry, J. M. Burnfield, Gait Analysis: Normal and Pathological Function, 2nd ed., "
        "SLACK, 2010"
    ),
    "Hollman 2011": (
        "J. H. Hollman, E. M. McDade, R. C. Petersen, Normative Spatiotemporal Gait Parameters in "
        "Older Adults, Gait & Posture 34(1), 2011, 111-118"
    ),
    "Hausdorff 2007": (
        "J. M. Hausdorff, Gait Dynamics, Fractals and Falls: Finding Meaning in the "
        "Stride-to-Stride Fluctuations of Human Walking, Human Movement Science 26(4), 2007, "
        "555-589"
    ),
    "Robinson 1987": (
        "R. O. Robinson, W. Herzog, B. M. Nigg, Use of Force Platform Variables to Quantify the "
        "Effects of Chiropractic Manipulation on Gait Symmetry, Journal of Manipulative and "
        "Physiological Therapeutics 10(4), 1987, 172-176"
    ),
    "El-Gohary 2014": (
        "M. El-Gohary et al., Continuous Monitoring of Turning in Patients with Movement "
        "Disability, Sensors 14(1), 2014, 356-369"
    ),
}
_SPECIAL: Mapping[str, str] = {
    "stance": "Perry 2010",
    "swing": "Perry 2010",
    "double support": "Perry 2010",
    "step time variability": "Hausdorff 2007",
    "step time asymmetry": "Robinson 1987",
    "step length asymmetry": "Robinson 1987",
    "turn duration": "El-Gohary 2014",
    "trunk sway": "",  # this project's
}


def source_of(parameter: str) -> str:
    """Return the key of the literature that defines a parameter; empty if none does."""
    return _SPECIAL.get(parameter, "Hollman 2011")
