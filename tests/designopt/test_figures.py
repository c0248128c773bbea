"""One look for all figures, without touching anybody's Matplotlib."""

import matplotlib
import pytest

from designopt.figures import PALETTE, STYLE, new_figure, save, style


def luminance(colour: str) -> float:
    red, green, blue = (int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def test_style_comes_and_goes():
    before = matplotlib.rcParams["font.size"]
    with style():
        assert matplotlib.rcParams["font.size"] == STYLE["font.size"]
    assert matplotlib.rcParams["font.size"] == before


def test_axes_are_always_two_dimensional():
    assert new_figure()[1].shape == (1, 1)
    assert new_figure(2, 3)[1].shape == (2, 3)


def test_the_same_drawing_gives_the_same_files(tmp_path):
    def write(name):
        with style():
            drawing, axes = new_figure()
            axes[0, 0].plot([1, 2], [3, 4])
            return [path.read_bytes() for path in save(drawing, tmp_path, name)]

    assert write("a") == write("b")
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    assert b"<svg" in (tmp_path / "a.svg").read_bytes()


@pytest.mark.parametrize("colour", PALETTE)
def test_every_colour_is_dark_enough_for_white_paper(colour):
    assert luminance(colour) < 0.7
