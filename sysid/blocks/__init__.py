"""What a result yields to be shown, and what draws it where a result shows itself.

`tables`, `figures` and `sections` are the blocks; `shown` is a result with a display. `plain_text`,
`notebook`, `terminal`, `drawing` (matplotlib) and `interactive` (Bokeh) render blocks; as
self-contained pages `html` is a page's frame (`templates/`), `svg` draws its figures, and
`standing` keeps it whole where a section cannot be made. `numbers` writes values with their
units. `progress` reports the progress of work.
"""
