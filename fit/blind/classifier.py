"""Baseline without physics: a linear classifier that names an effect from features of the gap.

The features are the base model's error by region, phase, frequency and direction, the shape of the missing force, and
the gap over the noise. They exclude all findings of the diagnosis on effects. The classifier is a ridge regression from
standardised features to one-hot labels, a linear discriminant. Each case is classified by the other cases
(leave-one-out, exact):

    b = (X'X + L I)^-1 X'Y,   prediction without case i: (X_i b - h_i Y_i) / (1 - h_i),   h = diag(X (X'X + L I)^-1 X')

Source: R. Rifkin, G. Yeo, T. Poggio, "Regularized least-squares classification" (2003); T. Hastie, R. Tibshirani,
J. Friedman, "The Elements of Statistical Learning", section 7.10 (leave-one-out of a linear smoother).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from formats.diagnosis_records import Diagnosis

RIDGE = 10.0  # ridge for standardised features: a few cases per label cannot determine fifty weights
# Of gap to noise. Our choice: few cases with large ratios would otherwise dominate the standardised feature. Half and
# double were not tried.
LARGEST_GAP_RATIO = 20.0


def features_of(said: Diagnosis) -> dict[str, float]:
    """Return the features of a diagnosis by name."""
    where, force = said.where, said.missing_force
    found = {
        f"{kind} {one.name}": one.share
        for kind in ("space", "time", "frequency", "term")
        for one in getattr(where, kind)
    }
    found["gap"] = min(said.gap.base_mm.value / max(said.gap.floor_mm.value, 1e-3), LARGEST_GAP_RATIO)
    if force is not None:
        found |= {"normal": force.normal_share, "odd": force.odd_share, "even": force.even_share}
        found |= {f"force {name}": share for name, share in force.spatial_share.items()}
        if force.amplitude_exponent is not None:
            found["exponent"] = force.amplitude_exponent
    return found


def leave_one_out(features: Sequence[dict[str, float]], labels: Sequence[str]) -> list[str]:
    """Return every case's label by a classifier trained on the other cases; a missing feature is set to its mean."""
    kinds, names = sorted(set(labels)), sorted({name for one in features for name in one})
    if len(labels) < 2 or not names:
        return ["" for _ in labels]
    table = np.array([[one.get(name, np.nan) for name in names] for one in features])
    centred = table - np.nanmean(table, axis=0)
    scaled = np.nan_to_num(centred / np.maximum(np.nanstd(table, axis=0), 1e-9))
    design = np.column_stack([np.ones(len(scaled)), scaled])
    wanted = np.array([[label == kind for kind in kinds] for label in labels], float)
    penalty = RIDGE * np.diag([0.0] + [1.0] * len(names))
    hat = design @ np.linalg.solve(design.T @ design + penalty, design.T)
    leverage = np.diag(hat)[:, None]
    without = (hat @ wanted - leverage * wanted) / np.maximum(1 - leverage, 1e-9)
    return [kinds[k] for k in without.argmax(1)]
