"""``oarlock check``: why a loop comes apart, and what would hold it.

- ``options``: what is asked; ``loops``: what the mechanism is, at one pose; ``runs``: what short runs show.
- ``lint``: what can be seen without a run.
- ``examined`` is what is found out, ``symptoms`` what a user sees besides how far loops open;
- ``examination`` looks at a model with all of them, once; ``edit`` writes copies of its file.
- ``reactions``: what goes through the equalities of one state of a user's own.
- ``verdict`` makes findings of an examination, ``page`` a document and a report; ``checked`` is the answer.
"""
