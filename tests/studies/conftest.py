"""Every figure that a study writes in these tests is looked at."""

import pytest

from designopt.plot import figures
from tests.readable import assert_readable


@pytest.fixture(autouse=True, scope="module")
def _look_at_figures():
    save = figures.save

    def looked_at(figure, folder, name):
        paths = save(figure, folder, name)
        try:
            assert_readable(figure)
        except AssertionError as error:
            raise AssertionError(f"{name}: {error}") from error
        return paths

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figures, "save", looked_at)
        yield
