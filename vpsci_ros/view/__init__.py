"""A page in which interactions play, seen from above: one file that opens from disk, for a browser and nothing else.

`sources` reads what is shown, `pack` makes it small, `page` writes the file. The page itself is in `templates`: plain
JavaScript on plain canvas. Two canvases and a list need 36 kB of script; the plotting and drawing libraries that could
be embedded bring 1 to 4 MB and no footprints, arcs or contacts.
"""
