"""Metrics of tracking: one record of ground truth and hypotheses, and the scores on it.

`scores.score(sequence, similarity)` gives all metrics of docs/method.md, section 9, for one
sequence. Scores hold counts and sums, so that `scores.combine` pools sequences properly; ratios are
taken at the end. `live` scores messages as they come, with the same counts.
"""
