"""Arrays that are kept in files: read again, and made again where they are damaged."""

import numpy as np
import pytest

from studies.oracles.judge.keeping import kept_arrays


class Counted:
    def __init__(self) -> None:
        self.times = 0

    def __call__(self) -> dict[str, object]:
        self.times += 1
        return {"light": np.arange(6.0).reshape(2, 3), "name": "x"}


def test_arrays_are_made_once_for_a_key(tmp_path):
    make = Counted()
    first, again = (kept_arrays(tmp_path, b"key", make) for _ in range(2))
    assert make.times == 1
    for found in (first, again):
        np.testing.assert_array_equal(found["light"], np.arange(6.0).reshape(2, 3))
        assert str(found["name"]) == "x"
    kept_arrays(tmp_path, b"another", make)
    assert make.times == 2
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize("cut", [slice(0), slice(1), slice(100), slice(-10), slice(60, 64)])
def test_what_is_damaged_is_made_again(tmp_path, cut):
    """What is cut off, or a few bytes within it."""
    make = Counted()
    kept_arrays(tmp_path, b"key", make)
    (file,) = tmp_path.iterdir()
    whole = file.read_bytes()
    file.write_bytes(whole[:60] + bytes(4) + whole[64:] if cut.start else whole[cut])
    kept_arrays(tmp_path, b"key", make)
    assert make.times == 2
    kept_arrays(tmp_path, b"key", make)
    assert make.times == 2


def test_nothing_is_kept_of_what_fails(tmp_path):
    def fails() -> dict[str, object]:
        raise RuntimeError("no light")

    with pytest.raises(RuntimeError, match="no light"):
        kept_arrays(tmp_path, b"key", fails)
    assert not list(tmp_path.iterdir())
