"""How things are shown: `numbers` and `channels` with their units, `tables` (and the results that
show themselves), `plots` (axes to draw on), `progress`, `terminal` and `text_plot`.
"""
