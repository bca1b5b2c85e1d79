"""What a user can ask for, one file each: what is given and its options in, a result out.

Options are a frozen dataclass, declared once (`request`). Commands pass it whole, `import sysid`
takes its fields by keyword. `run` is all requests in turn, `files` reads and writes.
"""
