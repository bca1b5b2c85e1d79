"""One file per kind of friction test; `sysid.friction` is the pipeline that calls them."""
