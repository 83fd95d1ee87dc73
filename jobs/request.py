"""What a user asks for: the body of an evaluation request."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, model_validator

Pixels = Annotated[int, Field(ge=1, le=8192)]
FrameNumber = Annotated[int, Field(ge=0, le=100_000)]


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


class EvaluationRequest(BaseModel):
    """Scenes × methods × settings × seeds × frames. size is (width, height), frames inclusive, noise that of the references."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    scenes: list[str] = Field(min_length=1, max_length=256)
    methods: list[MethodRequest] = Field(min_length=1, max_length=256)
    size: tuple[Pixels, Pixels] = (320, 180)
    seeds: int = Field(1, ge=1, le=256)
    frames: tuple[FrameNumber, FrameNumber] = (0, 0)
    noise: float = Field(0.01, gt=0, le=1)
    priority: int = Field(5, ge=0, le=9)

    @model_validator(mode="after")
    def _frames_are_ordered(self) -> EvaluationRequest:
        if self.frames[0] > self.frames[1]:
            raise ValueError(f"frames {self.frames[0]}:{self.frames[1]} run backwards")
        return self
