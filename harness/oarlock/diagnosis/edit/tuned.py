"""A tuned copy of an MJCF file: another timestep, integrator, solref and solimp."""

from pathlib import Path

from oarlock.diagnosis.edit.changes import Settings
from oarlock.diagnosis.edit.copy import write_changed
from oarlock.diagnosis.runs.trials import Setting


def write_tuned(source: Path, out: Path, setting: Setting) -> list[Path]:
    """Writes a copy of an MJCF file with a setting.

    Args:
        source: the MJCF file.
        out: where the copy goes; its folder must exist. Meshes, textures and such stay where they are.
        setting: for ``<option>`` and every equality.

    Returns:
        What was written: copies of included and attached files that have equalities or options of their own, beside
        ``out``, and ``out``.

    Raises:
        InputError: as ``write_changed``.
    """
    return write_changed(source, out, [Settings(setting)])
