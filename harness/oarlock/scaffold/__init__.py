"""``oarlock new``: a case around any MJCF file."""
