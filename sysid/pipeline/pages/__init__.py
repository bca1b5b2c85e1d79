"""The pages that results are written to, from the sections that their rooms describe.

`report` puts the report's sections in turn, of which `opening` (the verdict on top),
`concerns`, `motion` and `next_steps` draw on several results. `loop`, `controllers` and `fleet`
are pages of their own. `sysid.blocks` renders them.
"""
