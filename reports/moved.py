"""References whose bytes differ between two runs: the truth itself moved, or only its noise did."""

from __future__ import annotations

import numpy as np

from renderers.images import luminance
from reports.change import ReferenceChange
from reports.folder import Evaluation, ReferenceInfo
from reports.stored import Images, StoredReference

# Mean squared difference over the sum of both variances is 1 for independent noise, and its standard deviation over N pixels is
# about sqrt(2.5 / N) (F distribution, 1 and 30 degrees of freedom), 0.07 at N = 576; less where replicates are shared.
LARGEST_SPREAD = 2.0


def references_moved(part: str, before: Images, old: Evaluation, after: Images, new: Evaluation) -> list[ReferenceChange]:
    """Changes of all references of the same id whose content hashes differ."""
    olds = {info.id: info for info in old.references}
    scenes = {s.name: s.hash for s in old.scenes}
    comparable = {s.name for s in new.scenes if scenes.get(s.name) == s.hash}
    found = []
    for info in new.references:
        earlier = olds.get(info.id)
        if earlier is not None and earlier.content_hash != info.content_hash and info.scene in comparable:
            found.append(_moved(part, info, before.stored(earlier), after.stored(info)))
    return found


def _moved(part: str, info: ReferenceInfo, a: StoredReference | None, b: StoredReference | None) -> ReferenceChange:
    change = ReferenceChange(
        part=part, id=info.id, scene=info.scene, transport=info.transport, frame=info.frame, verdict="undecided",
        reason="an image is missing",
    )  # fmt: skip
    if a is None or b is None:
        return change
    if a.mean.shape != b.mean.shape:
        return change.model_copy(update={"verdict": "new", "reason": "another size than before"})
    from scipy import stats

    difference = luminance(b.mean) - luminance(a.mean)
    variance = a.luminance_variance.astype(np.float64) + b.luminance_variance
    total, noise = float(difference.sum()), float(np.sqrt(variance.sum()))
    mean = float(luminance(a.mean).mean())
    spread = float((difference**2).sum() / variance.sum()) if noise > 0 else None
    wide = spread is None or spread > LARGEST_SPREAD
    return change.model_copy(
        update={
            "energy": total / difference.size / mean if mean > 0 else None,
            "p": float(2 * stats.norm.sf(abs(total) / noise)) if noise > 0 else None,
            "spread": spread,
            "verdict": "regression" if wide else "changed-within-noise",
            "reason": "its pixels moved beyond its own noise" if wide else "only its noise differs",
        }
    )
