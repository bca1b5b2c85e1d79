"""Blocks rendered as self-contained HTML pages.

`html` is the frame of a page (`templates/`), `svg` draws its figures, and `standing` keeps a page
whole where a section cannot be made.
"""
