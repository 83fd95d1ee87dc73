"""Temporal caching with exactly known light: the specification's toy (A10), and splats in single precision (A17)."""

import numpy as np
from temporal_toy import Lamps, normals

from renderers.transport.caching.records import Records, Sites
from renderers.transport.caching.splat import Canvas
from renderers.transport.temporal.records import Trends


def test_a10_trends_of_translation_gradients_are_gradients_of_trends() -> None:
    """Mixed partial derivatives agree: ∂/∂t ∇_p E = ∇_p ∂E/∂t."""
    rng, h = np.random.default_rng(0), 1e-3
    position = np.concatenate([rng.uniform(-0.9, 0.9, (40, 2)), np.zeros((40, 1))], axis=1)
    normal = normals(position)

    def sites(shift: np.ndarray) -> Sites:
        return Sites(position + shift, normal, normal)

    def trends(shift: np.ndarray) -> Trends:
        first, last = (Lamps(10 + s * h, 1.0).records(sites(shift)) for s in (-1, 1))
        return Trends.between(first, last, np.full(40, 2 * h))

    of_gradient = trends(np.zeros(3)).translation[:, 0, :2]
    gradient_of = np.stack([(trends(h * e).irradiance - trends(-h * e).irradiance)[:, 0] / (2 * h) for e in np.eye(3)[:2]], axis=1)
    assert np.abs(of_gradient - gradient_of).max() <= 1e-5 * np.abs(of_gradient).max()


def test_a17_five_hundred_signed_terms_in_single_precision() -> None:
    rng, count = np.random.default_rng(1), 500
    point, up = np.zeros((1, 3)), np.array([[0.0, 0, 1]])
    position = np.concatenate([rng.uniform(-0.05, 0.05, (count, 2)), np.zeros((count, 1))], axis=1)
    gradient = rng.normal(size=(count, 3, 3)) * 5
    records = Records(position, np.repeat(up, count, 0), np.ones(count), rng.random((count, 3)) + 1, gradient, gradient)
    values = []
    for dtype in (np.float32, np.float64):
        canvas = Canvas(np.zeros(1, np.intp), 1, point, up, dtype)
        canvas.add(records, 0.4)
        values.append(canvas.irradiance[0].astype(np.float64))
    np.testing.assert_allclose(values[0], values[1], rtol=1e-5)
