"""The messages that a page sends, checked where they come in: anything can be sent to a socket."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

LONGEST = 2**16
"""Bytes of a message; those of the page have a few hundred."""

Name = Annotated[str, Field(min_length=1, max_length=1000)]
Count = Annotated[int, Field(ge=0, lt=2**53)]
Length = Annotated[float, Field(ge=-1e9, le=1e9)]


class MessageError(ValueError):
    """A message that no page of the design sends; what is wrong with it, in a line of ASCII."""

    def __init__(self, fault: str) -> None:
        # What is wrong may be quoted, at any length.
        super().__init__(ascii(fault)[1:110].rstrip("'\""))


class _Message(BaseModel):
    model_config = ConfigDict(strict=True, frozen=True, allow_inf_nan=False, extra="forbid")


class Signal(_Message):
    """Something without further content."""

    type: Literal["ack", "undo", "redo", "stop"]


class SetValues(_Message):
    """New values of parameters.

    Attributes:
        seq: counts what a tab sends; what is shown of it comes back with this number.
        gesture: one number for all changes that are undone together.
    """

    type: Literal["set"]
    values: Annotated[dict[Name, float], Field(min_length=1, max_length=1000)]
    seq: Count
    gesture: Count


class Drag(_Message):
    """A handle that is dragged to a place, mm."""

    type: Literal["drag"]
    handle: Name
    x: Length
    y: Length
    seq: Count
    gesture: Count


class Lock(_Message):
    """A parameter that is locked, or no longer."""

    type: Literal["lock"]
    name: Name
    locked: bool


class Limit(_Message):
    """New bounds of a parameter."""

    type: Literal["bounds"]
    name: Name
    low: float
    high: float


class Preset(_Message):
    """Values to take, by the preset's name, or to store under it."""

    type: Literal["preset", "store"]
    name: Annotated[str, Field(min_length=1, max_length=1000, pattern=r"\S")]


class Optimise(_Message):
    """A measure to improve."""

    type: Literal["optimise"]
    measure: Name


class Save(_Message):
    """Files to write, also of a design that fails a requirement or not."""

    type: Literal["save"]
    although_failing: bool


Message = Signal | SetValues | Drag | Lock | Limit | Preset | Optimise | Save

_MESSAGES: TypeAdapter[Message] = TypeAdapter(Annotated[Message, Field(discriminator="type")])


def read_message(text: str | bytes) -> Message:
    """A message, in which every number is finite and in its range.

    Raises:
        MessageError: the text is no message of the page.
    """
    try:
        return _MESSAGES.validate_json(text)
    except ValidationError as error:
        fault = error.errors(include_url=False, include_context=False, include_input=False)[0]
        place = ".".join(map(str, fault["loc"])) or "message"
        raise MessageError(f"{place}: {fault['msg']}") from None
