"""Display: `numbers` and `channels` with their units, `tables` (and results with a display of their
own), `plots` (axes to draw on), `progress`, `terminal` and `text_plot`.
"""
