"""What a user asks for: the body of an evaluation request."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, model_validator

Pixels = Annotated[int, Field(ge=1, le=8192)]
FrameNumber = Annotated[int, Field(ge=0, le=100_000)]
SHORT = 20  # a range that has references in all its frames; longer ones begin and end with so many


class MethodRequest(BaseModel):
    """One method, its settings, and lists of values to sweep (their product is rendered)."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    name: str
    settings: dict[str, Any] = {}
    sweep: dict[str, list[Any]] = {}

    @model_validator(mode="after")
    def _sweeps_are_not_empty(self) -> MethodRequest:
        empty = [key for key, values in self.sweep.items() if not values]
        if empty:
            raise ValueError(f"sweep of {empty[0]} has no values")
        both = sorted(set(self.sweep) & set(self.settings))
        if both:
            raise ValueError(f"{both[0]} is both set and swept")
        return self


class ReferenceFrames(BaseModel):
    """Which frames of a sequence are compared with references: the first, every k-th after it, and all of each window."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    every: int | None = Field(None, ge=1, le=100_000, description="Every k-th frame, counted from the first.")
    windows: list[tuple[FrameNumber, FrameNumber]] = Field(
        [], max_length=64, description="Ranges of consecutive frames, both ends included: flicker is measured inside them."
    )

    def chosen(self, first: int, last: int) -> list[int]:
        """The frames of `first` … `last` that have references, in order."""
        found = {first} if self.every is None else set(range(first, last + 1, self.every))
        for begin, end in self.windows:
            found |= set(range(begin, end + 1))
        return sorted(found)


class EvaluationRequest(BaseModel):
    """Scenes × methods × settings × seeds × frames. size is (width, height), frames inclusive, noise that of the references.

    references: which frames have them. Left out, a range of up to 20 frames has them all, a longer one every 10th and the first
    and last 20.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    scenes: list[str] = Field(min_length=1, max_length=256)
    methods: list[MethodRequest] = Field(min_length=1, max_length=256)
    size: tuple[Pixels, Pixels] = (320, 180)
    seeds: int = Field(1, ge=1, le=256)
    frames: tuple[FrameNumber, FrameNumber] = (0, 0)
    noise: float = Field(0.01, gt=0, le=1)
    priority: int = Field(5, ge=0, le=9)
    references: ReferenceFrames | None = None

    @property
    def reference_frames(self) -> list[int]:
        """Frames that are compared with references; the first always is."""
        first, last = self.frames
        chosen = self.references
        if chosen is None and last - first < SHORT:
            return list(range(first, last + 1))
        if chosen is None:
            windows = [(first, first + SHORT - 1), (last - SHORT + 1, last)]
            chosen = ReferenceFrames(every=10, windows=windows)
        return chosen.chosen(first, last)

    @model_validator(mode="after")
    def _frames_are_ordered(self) -> EvaluationRequest:
        if self.frames[0] > self.frames[1]:
            raise ValueError(f"frames {self.frames[0]}:{self.frames[1]} run backwards")
        return self

    @model_validator(mode="after")
    def _windows_lie_in_the_frames(self) -> EvaluationRequest:
        for begin, end in () if self.references is None else self.references.windows:
            if not self.frames[0] <= begin <= end <= self.frames[1]:
                raise ValueError(f"window {begin}:{end} of references does not lie in frames {self.frames[0]}:{self.frames[1]}")
        return self
