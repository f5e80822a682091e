"""The notebooks run from their first cell to their last, and are kept without what they print."""

import re
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient
from places import REPOSITORY

NOTEBOOKS = sorted((REPOSITORY / "examples" / "notebooks").glob("*.ipynb"))

PATIENCE_S = 300


def _read(path: Path) -> nbformat.NotebookNode:
    return nbformat.read(path, as_version=4)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_kept_clean(path):
    nbformat.validate(_read(path))
    cells = [cell for cell in _read(path).cells if cell.cell_type == "code"]
    assert len(cells) >= 3
    assert [cell for cell in cells if cell.outputs or cell.execution_count] == []
    assert re.findall(r"/(?:home|root|tmp|Users)/", path.read_text(encoding="utf-8")) == []


def test_documents_name_every_notebook():
    page = (REPOSITORY / "docs" / "how-to" / "examples.md").read_text(encoding="utf-8")
    assert len(NOTEBOOKS) == 4
    assert [path.name for path in NOTEBOOKS if f"`{path.name}`" not in page] == []


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # of the kernel's own parts
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path):
    notebook = _read(path)
    client = NotebookClient(notebook, timeout=PATIENCE_S, resources={"metadata": {"path": str(path.parent)}})
    client.execute()
    shown = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    assert len(shown) >= 3
    assert [output for output in shown if output.output_type == "error"] == []
