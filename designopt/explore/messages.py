"""The messages that a page sends, checked where they come in: anything can be sent to a socket."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

LONGEST = 2**16
"""Bytes of a message; those of the page have a few hundred."""

Place = Annotated[float, Field(ge=-1e6, le=1e6)]
"""Across or down from the picture's upper left corner, pixels of the screen."""


class _Message(BaseModel):
    model_config = ConfigDict(strict=True, frozen=True, allow_inf_nan=False)


class Signal(_Message):
    """Something without further content that happened to a tab."""

    type: Literal["ack", "refresh", "resize", "draw"]


class Pointer(_Message):
    """What a mouse did; numbers of buttons are those of the DOM."""

    type: Literal["button_press", "button_release", "motion_notify", "figure_enter", "figure_leave"]
    x: Place
    y: Place
    button: Annotated[int, Field(ge=0, le=31)]
    buttons: Annotated[int, Field(ge=0, lt=2**32)]


class PixelRatio(_Message):
    """Pixels of the screen per pixel of the page, which a browser's zoom changes, too."""

    type: Literal["set_device_pixel_ratio"]
    device_pixel_ratio: Annotated[float, Field(ge=0.01, le=100)]


class Unused(_Message):
    """What Matplotlib's script sends and this page has no use for."""

    type: Literal[
        "dblclick",
        "key_press",
        "key_release",
        "scroll",
        "send_image_mode",
        "supports_binary",
        "toolbar_button",
    ]


Message = Signal | Pointer | PixelRatio | Unused

_MESSAGES: TypeAdapter[Message] = TypeAdapter(Annotated[Message, Field(discriminator="type")])


def read_message(text: str | bytes) -> Message:
    """A message, in which every number is finite and in its range.

    Raises:
        ValueError: the text is no message of the page; what is wrong with it, in one line of ASCII.
    """
    try:
        return _MESSAGES.validate_json(text)
    except ValidationError as error:
        fault = error.errors(include_url=False, include_context=False, include_input=False)[0]
        place = ".".join(map(str, fault["loc"])) or "message"
        # What is wrong may be quoted, at any length.
        raise ValueError(ascii(f"{place}: {fault['msg']}")[1:120].rstrip("'\"")) from None
