"""What a Frame accepts."""

from __future__ import annotations

import numpy as np
import pytest

from renderers import Frame

IMAGE = np.full((3, 4, 3), 2.0, np.float32)
PICTURE = np.full((3, 4, 3), 0.5, np.float32)
NAME = "debug.records"
CAPTION = {NAME: "white: a record"}


def test_a_diagnostic_picture_has_colours_and_a_caption() -> None:
    frame = Frame({"beauty": IMAGE, NAME: PICTURE}, captions=CAPTION)
    assert frame.captions[NAME] == "white: a record"


@pytest.mark.parametrize(
    ("layers", "captions", "message"),
    [
        ({NAME: PICTURE}, {}, "no caption"),
        ({NAME: PICTURE * 3}, CAPTION, "colours 0..1"),
        ({NAME: -PICTURE}, CAPTION, "colours 0..1"),
        ({NAME: PICTURE[..., :1]}, CAPTION, "must be float32"),
        ({"debug.Records!": PICTURE}, {"debug.Records!": "white: a record"}, "debug.some-name"),
        ({}, CAPTION, "captions without a layer: debug.records"),
    ],
)
def test_what_a_report_could_not_show_is_refused(layers: dict[str, np.ndarray], captions: dict[str, str], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Frame({"beauty": IMAGE, **layers}, captions=captions)


def test_a_diagnostic_picture_must_be_finite_too() -> None:
    with pytest.raises(FloatingPointError, match="not finite"):
        Frame({"beauty": IMAGE, NAME: PICTURE * np.float32(np.nan)}, captions=CAPTION)
