"""The parameter bundle: what a controller, a simulator or a later fit needs, in one JSON file."""

from sysid.bundle.content import read_bundle, write_bundle

__all__ = ["read_bundle", "write_bundle"]
