"""What a user can request, one file each: inputs and options in, a result out.

Options are a frozen dataclass, declared once (`request`). Commands pass it whole, `import sysid`
takes its fields by keyword. `run` is all requests in turn, `files` reads and writes.
"""
