"""Metrics of tracking: one record of ground truth and hypotheses, and the scores on it.

`scores.score(sequence, similarity)` gives all metrics of docs/method.md, section 9, for one
sequence. Scores are counts and sums, which `scores.combine` pools over sequences; ratios are
computed last. `live` scores messages on arrival, with the same counts.
"""
