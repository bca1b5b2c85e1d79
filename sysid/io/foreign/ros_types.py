"""ROS messages by their definitions, which MCAP files and bags hold, by rosbags.

rosbags makes Python classes of a definition's names, so these are checked first: a file's text
is never run.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

_TYPE = re.compile(r"[A-Za-z]\w*(?:/\w+)*", re.ASCII)
_FIELD = re.compile(r"[A-Za-z_]\w*", re.ASCII)
Decoder = Callable[[bytes], Any]


def ros_decoder(name: str, definition: str, encoding: str, *, is_cdr: bool) -> Decoder:
    """What turns a message's bytes into an object with its fields.

    `encoding` of the definition is "ros2msg", "ros1msg", "ros2idl", or "" where there is none:
    then it is one of ROS 2's own, of the release that fits the messages. Types are in a store of
    their own: two topics may define one differently. Raises ValueError where the type is not
    known.
    """
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    if not encoding:
        return _of_some_release(name)
    store = get_typestore(Stores.EMPTY)
    is_idl = encoding == "ros2idl"
    types = get_types_from_idl(definition) if is_idl else get_types_from_msg(definition, name)
    _check_names(types)
    store.register({key: known for key, known in types.items() if key not in store.fielddefs})
    if name not in store.fielddefs:
        name = next(key for key in types if key.replace("/msg/", "/") == name)
    read = store.deserialize_cdr if is_cdr else store.deserialize_ros1
    return lambda data: read(data, name)


def _of_some_release(name: str) -> Decoder:
    """Messages of a type of ROS 2's own, by the newest release whose definition fits them all."""
    from rosbags.typesys import Stores, get_typestore

    names = [store for store in Stores if store.name.startswith("ROS2_")]
    stores = [get_typestore(store) for store in reversed(names)]
    fitting = [store for store in stores if name in store.fielddefs]
    if not fitting:
        raise ValueError(f"the file does not define its message type, {name}")

    def decode(data: bytes) -> Any:
        while True:
            try:
                return fitting[0].deserialize_cdr(data, name)
            except Exception:
                if len(fitting) == 1:
                    raise
                del fitting[0]

    return decode


def _check_names(types: Any) -> None:
    """ValueError where a definition holds anything but names for its types and fields."""
    names, fields = set(types), set[str]()
    for constants, parts in types.values():
        fields |= {part[0] for part in (*constants, *parts)}
        for _, described in parts:
            names |= set(_types_in(described))
    if not all(_TYPE.fullmatch(str(name)) for name in names):
        raise ValueError("a message type's name is none")
    if not all(_FIELD.fullmatch(str(name)) for name in fields):
        raise ValueError("a field's name is none")


def _types_in(described: Any) -> list[str]:
    """The names of types in a field's description, however deep."""
    if isinstance(described, str):
        return [described]
    if isinstance(described, tuple | list):
        return [name for part in described for name in _types_in(part)]
    return []


__all__ = ["Decoder", "ros_decoder"]
