"""What can be seen of a model without a run: from its file, and at one pose. Milliseconds.

``view`` is what is looked at, ``lints`` the list of those who look; each of the other files is one kind of finding. A
lint takes a view and gives remarks. A new one is one file here, one line in ``lints``, and an entry of the catalogue.
"""
