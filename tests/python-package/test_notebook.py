"""The notebook of the examples, run by a kernel of Jupyter as its users run it."""

import pathlib
import time

import nbclient
import nbformat
import pytest

NOTEBOOK = pathlib.Path(__file__).parents[2] / "trainer-host/python/examples/hover.ipynb"


@pytest.fixture(scope="module")
def cells(tmp_path_factory):
    """Outputs of its cells of code, by name."""
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    begun = time.monotonic()
    place = tmp_path_factory.mktemp("notebook")
    nbclient.NotebookClient(notebook, timeout=1200, resources={"metadata": {"path": place}}).execute()
    print(f"the notebook took {time.monotonic() - begun:.0f} s")
    return {cell.id: cell.outputs for cell in notebook.cells if cell.cell_type == "code"}


def test_the_notebook_ships_without_outputs():
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    nbformat.validate(notebook)
    assert all(not cell.outputs and cell.execution_count is None for cell in notebook.cells if cell.cell_type == "code")


def test_the_curve_is_drawn_where_the_training_was_begun(cells):
    assert any("<svg" in output.data["text/html"] for output in cells["train"] if output.output_type == "display_data")


def test_hover_is_learned(cells):
    (said,) = cells["evaluation"]
    rates = {line[:16].strip(): float(line[16:22]) for line in said.text.splitlines()}
    assert rates["fixed16"] > 98 and rates["do nothing"] < 5
    (flown,) = cells["fly"]
    successes, episodes = (int(word) for word in flown.data["text/plain"].strip("'").split(" ")[:3:2])
    assert successes >= 0.97 * episodes


def test_the_film_is_shown(cells):
    (shown,) = cells["film"]
    assert 'src="data:image/gif;base64,R0lGODlh' in shown.data["text/html"]


def test_the_app_is_exported(cells):
    (exported,) = cells["export"]
    assert "crazyflie" in exported.data["text/plain"]
