"""What counts as an image: one check for all that take one, and one line for whatever is none."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int, UInt8

from designopt.errors import UserError

CHANNELS = {1: "one channel", 3: "red, green and blue"}

CONVERSIONS = {
    "b": "convert it with 255 * image.astype(numpy.uint8)",
    "f": "convert it with (255 * image).astype(numpy.uint8) if 1 is white",
    "u": "convert it with (image >> 8).astype(numpy.uint8) if it has 16 bits",
    "i": "convert it with image.clip(0, 255).astype(numpy.uint8)",
}
"""By NumPy's kinds of numbers."""

NOT_READ = "look whether the camera or the file was read"

BRIGHTNESS = "the brightness of an image"

AROUND = 16
"""Pixels about a contour in which brightness must be finite: edges are looked for in half as many.
"""


def checked_image(
    image: object,
    *,
    channels: tuple[int, ...] = (3,),
    like: tuple[str, tuple[int, ...]] | None = None,
    what: str = "an image",
) -> UInt8[np.ndarray, "rows columns *channels"]:
    """An image of bytes, contiguous in memory; that of one channel has no axis for it.

    Args:
        image: anything.
        channels: numbers of channels that are allowed, of 1 and 3.
        like: a name, and the rows and columns that it has and the image must have.
        what: it is, for the message.

    Raises:
        UserError: it is no such image; the line has what it is, and how to come by one.
    """
    array = _checked_array(image, what)
    wanted = f"{what} has " + " or ".join(CHANNELS[number] for number in channels)
    if array.dtype != np.uint8:
        cure = CONVERSIONS.get(array.dtype.kind, "give numbers from 0 to 255")
        raise UserError(f"{wanted} of 8 bits (uint8), not {array.dtype}; {cure}")
    if array.ndim not in (2, 3):
        cure = "give one image of the stack, such as images[0]" if array.ndim == 4 else "reshape it"
        raise UserError(f"{wanted} in rows and columns, not the shape {array.shape}; {cure}")
    given = array.shape[2] if array.ndim == 3 else 1
    if given not in channels or (array.ndim == 3 and given == 1):
        cures = {1: "give image[..., 0]" if 1 in channels else "give the image with its colours",
                 3: "give one channel, such as image.max(axis=2)",
                 4: "leave out the last channel with image[..., :3]"}  # fmt: skip
        cure = cures.get(given, "turn its axes so that the channels come last, or choose channels")
        raise UserError(f"{wanted}, not the shape {array.shape}; {cure}")
    if not array.size:
        raise UserError(f"{what} has no pixels (its shape is {array.shape}); {NOT_READ}")
    if like is not None and array.shape[:2] != like[1]:
        turned = array.shape[1::-1] == like[1]
        cure = "turn it with numpy.rot90(image)" if turned else "give one as large"
        raise UserError(
            f"{what} has {_size(array.shape)} px (columns x rows), and {like[0]} has "
            f"{_size(like[1])} px; {cure}"
        )
    return np.ascontiguousarray(array)


def checked_brightness(
    gray: object, shape: tuple[int, int], contour: Int[np.ndarray, "_ 2"]
) -> None:
    """That brightness can be sampled about a contour.

    Raises:
        UserError: it is not float32, not finite there, or has other rows and columns.
    """
    cure = "give image.max(axis=2).astype(numpy.float32) of an image of the lens"
    low, high = contour.min(axis=0) - AROUND, contour.max(axis=0) + AROUND + 1
    rows, columns = (slice(max(low[i], 0), high[i]) for i in (1, 0))
    array = _checked_array(gray, BRIGHTNESS)
    if array.shape != shape or array.dtype != np.float32:
        raise UserError(
            f"{BRIGHTNESS} is float32 of the shape {shape}, not {array.dtype} of {array.shape}; "
            f"{cure}"
        )
    checked_floats(array[rows, columns], ("rows", "columns"), what=BRIGHTNESS, cure=cure)


def checked_floats(
    array: object, shape: tuple[int | str, ...], *, what: str, cure: str
) -> Float[np.ndarray, "..."]:
    """An array of finite floats.

    Args:
        array: anything.
        shape: lengths of its axes; names for those that may be anything.
        what: it is, for the message.
        cure: how to come by one, for the message.

    Raises:
        UserError: it is no such array.
    """
    floats = _checked_array(array, what)
    fits = len(shape) == floats.ndim and all(
        isinstance(one, str) or one == length
        for one, length in zip(shape, floats.shape, strict=True)
    )
    wanted = f"({', '.join(map(str, shape))})"
    if not fits:
        raise UserError(f"{what} has the shape {wanted}, not {floats.shape}; {cure}")
    if floats.dtype.kind != "f":
        raise UserError(f"{what} has floats, not {floats.dtype}; {cure}")
    if not np.isfinite(floats).all():
        raise UserError(f"{what} has values that are not finite; {cure}")
    return floats


def _checked_array(array: object, what: str) -> np.ndarray:
    if isinstance(array, np.ndarray):
        return array
    if array is None:
        raise UserError(f"{what} is missing (None); {NOT_READ}")
    raise UserError(
        f"{what} is a NumPy array, not {type(array).__name__}; convert it with numpy.asarray"
    )


def _size(shape: tuple[int, ...]) -> str:
    return f"{shape[1]}x{shape[0]}"
