"""Messages of recorders (MCAP, ROS bags) as columns: a field is `/topic.field.sub[0]`.

A topic's times are those of its messages' `header.stamp`, where the stamps are set and run forward,
else those at which the recorder logged them. Values of arrays whose elements have names
(`sensor_msgs/JointState`) are also known by these: `/joint_states.position[elbow]`.
"""

from __future__ import annotations

import dataclasses
from array import array
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.errors import input_error, shortened, some_of
from sysid.io.bounds import MOST_DEPTH, Cells, check_columns
from sysid.io.foreign.ros_types import Decoder
from sysid.io.foreign.table import ForeignTable

# Elements of an array that are columns; longer ones are images, scans, clouds of points.
MOST_ELEMENTS = 1024
_STAMPS = ("header.stamp", "stamp", "timestamp")
_LABELS = ("name", "names")
_SECONDS = ({"sec", "nanosec"}, {"sec", "nsec"}, {"secs", "nsecs"}, {"seconds", "nanos"})
_NS = 10**9
_MOST_NS = np.iinfo(np.int64).max

Times = NDArray[np.int64]


@dataclass
class _Values:
    """The values of a field, message by message: numbers, arrays of them, or times in ns.

    `numbers` holds the elements of all arrays, one after the other, `lengths` how many are of each.
    """

    kind: str
    numbers: array[Any] = field(default_factory=lambda: array("d"))
    lengths: array[int] = field(default_factory=lambda: array("q"))
    messages: array[int] = field(default_factory=lambda: array("q"))
    is_long: bool = False

    def rows(self, index: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.float64]]:
        """Which arrays have an element at `index` (one for each array; below 0: none), and it."""
        lengths = np.array(self.lengths, dtype=np.intp)
        starts = np.cumsum(lengths) - lengths
        which = np.flatnonzero((index >= 0) & (index < lengths))
        return which, np.array(self.numbers)[starts[which] + index[which]]


@dataclass
class _Topic:
    """The messages of a topic so far: when each was logged (ns), its fields, and its labels."""

    logged: array[int] = field(default_factory=lambda: array("q"))
    fields: dict[str, _Values] = field(default_factory=dict)
    labels: dict[str, list[tuple[str, ...]]] = field(default_factory=dict)
    skipped: dict[str, str] = field(default_factory=dict)
    _known: dict[tuple[str, ...], tuple[str, ...]] = field(default_factory=dict)

    def label(self, name: str, found: tuple[str, ...]) -> None:
        """Note the names in a message's array of names."""
        self.labels.setdefault(name, []).append(self._known.setdefault(found, found))


class Messages:
    """Takes the messages of a file one by one, and gives their columns to a table."""

    def __init__(self, table: ForeignTable) -> None:
        self._table, self._cells = table, Cells(table.path)
        self._topics: dict[str, _Topic] = {}
        self._skipped: set[str] = set()
        self._names = 0

    def __len__(self) -> int:
        return sum(len(topic.logged) for topic in self._topics.values())

    def decoder_of(self, topic: str, encoding: str, make: Callable[[], Decoder]) -> Decoder | None:
        """What decodes a topic's messages; None, with the reason in `skipped`, without any."""
        try:
            return make()
        except ModuleNotFoundError as error:
            package = "protobuf" if encoding == "protobuf" else str(error.name)
            reason = f"its messages are {encoding} (pip install {package})"
        except Exception as error:  # parsers of definitions raise errors of their own
            reason = f"its messages are not decoded ({_in_short(error)})"
        self._table.skipped.setdefault(topic, reason)
        return None

    def decode(self, topic: str, decoder: Decoder | None, data: bytes, logged_ns: int) -> None:
        """Add a message by its bytes; nothing without a decoder.

        A topic whose first message does not match its definition is skipped: others of the file
        remain valid. Raises ValueError where a later message does not match.
        """
        if decoder is None or topic in self._skipped:
            return
        try:
            message = decoder(data)
        except Exception as error:  # decoders raise errors of their own
            reason = _in_short(error)
            if topic in self._topics:
                raise ValueError(f"a message of topic {topic}: {reason}") from None
            self._skipped.add(topic)
            self._table.skipped[topic] = f"its messages do not fit their definition ({reason})"
            return
        self.add(topic, message, logged_ns)

    def add(self, topic: str, message: Any, logged_ns: int) -> None:
        """A message: nested mappings or dataclasses of numbers, texts and sequences.

        `logged_ns` is when it was recorded, ns. Raises InputError beyond the bounds.
        """
        about = self._topics.setdefault(topic, _Topic())
        number = len(about.logged)
        about.logged.append(logged_ns)
        for name, value in _leaves("", message, 0):
            self._take(about, topic, name or "value", value, number)

    def _take(self, about: _Topic, topic: str, name: str, value: Any, number: int) -> None:
        if isinstance(value, str):
            about.skipped.setdefault(name, value)
            return
        if isinstance(value, tuple):
            if value and isinstance(value[0], str):
                self._cells.add(len(value), f"topic {topic}")
                about.label(name, value)
            return
        kind = "numbers" if isinstance(value, float | int) else "arrays"
        if isinstance(value, _Time):
            kind = "spans" if value.is_span else "times"
        held = about.fields.get(name)
        if held is None:
            self._names += 1
            check_columns(self._table.path, self._names)
            held = about.fields[name] = _Values(kind)
            if kind in ("times", "spans"):
                held.numbers = array("q")
        if held.kind != kind:
            held.is_long = held.is_long or kind == "arrays"
            return
        if kind == "arrays":
            if len(value) > MOST_ELEMENTS:
                held.is_long = True
            if held.is_long or not len(value):
                return
            self._cells.add(len(value), f"topic {topic}")
            held.numbers.frombytes(np.asarray(value, dtype=np.float64).tobytes())
            held.lengths.append(len(value))
        else:
            self._cells.add(1, f"topic {topic}")
            held.numbers.append(value.ns if isinstance(value, _Time) else value)
        held.messages.append(number)

    def finish(self) -> None:
        """Give the table the columns, their clocks, the origin and the notices.

        Raises InputError where no topic has a number.
        """
        if self._topics:
            self._give_all()
        if not self._table.columns and self._table.skipped:
            name, reason = next(iter(self._table.skipped.items()))
            raise input_error(
                self._table.path,
                f"holds no numbers: {name}: {reason}",
                "install what is missing"
                if "pip install" in reason
                else "record topics with numbers (JSON, ROS, protobuf)",
            )

    def _give_all(self) -> None:
        logged = {name: np.array(topic.logged) for name, topic in self._topics.items()}
        begun = min(int(times.min()) for times in logged.values())
        ended = max(int(times.max()) for times in logged.values())
        stamps, told = {}, dict[str, list[str]]()
        for name, topic in self._topics.items():
            times, reason = _stamps(topic, logged[name], begun, ended)
            if times is not None:
                stamps[name] = times
            told.setdefault(reason, []).append(name)
        elsewhere = told.get(_ELSEWHERE, [])
        if elsewhere and len(elsewhere) == len(self._topics):  # one clock, though not the logger's
            told = {_STAMPED: elsewhere}
        else:
            stamps = {name: times for name, times in stamps.items() if name not in elsewhere}
        clocks = logged | stamps
        origin = min(int(times.min()) for times in clocks.values())
        self._set_origin(origin)
        for reason, names in told.items():
            shown = some_of([*map(shortened, names)], 8, counted=False)
            self._table.notices.append(f"{self._table.path}: {reason}: {shown}")
        for name, topic in self._topics.items():
            self._give(name, topic, clocks[name], origin)

    def _set_origin(self, origin: int) -> None:
        import pandas as pd

        self._table.origin = pd.Timestamp(origin, unit="ns", tz="UTC")

    def _give(self, name: str, topic: _Topic, clock_ns: Times, origin: int) -> None:
        clock = (clock_ns - origin) / _NS
        order = None if np.all(np.diff(clock) >= 0) else np.argsort(clock, kind="stable")
        for path, held in topic.fields.items():
            full = f"{name}.{path}"
            if held.is_long:
                self._table.skipped[full] = f"an array of more than {MOST_ELEMENTS:,} values"
            elif not held.messages:
                self._table.skipped[full] = "empty"
            elif held.kind == "arrays":
                self._give_array(name, path, topic, clock, order)
            else:
                values = np.array(held.numbers)
                if held.kind == "times":
                    values = values.view("M8[ns]")
                elif held.kind == "spans":
                    values = values / _NS
                self._put(full, values, np.array(held.messages), clock, order)
        for path in topic.skipped:
            if path not in topic.fields:
                self._table.skipped[f"{name}.{path}"] = "text"

    def _put(
        self,
        name: str,
        values: NDArray[Any],
        messages: NDArray[Any],
        clock: NDArray[np.float64],
        order: NDArray[Any] | None,
    ) -> None:
        """A column, of the messages that had it, in the order of their times."""
        if order is not None:
            rank = np.empty(len(order), dtype=np.intp)
            rank[order] = np.arange(len(order))
            by_time = np.argsort(rank[messages], kind="stable")
            values, messages = values[by_time], messages[by_time]
        whole = len(messages) == len(clock) and order is None
        self._table.columns[name] = values
        self._table.clocks[name] = clock if whole else clock[messages]

    def _give_array(
        self,
        name: str,
        path: str,
        topic: _Topic,
        clock: NDArray[np.float64],
        order: NDArray[Any] | None,
    ) -> None:
        """An array's elements: by their numbers, and by their names where they have some."""
        held = topic.fields[path]
        lengths = np.array(held.lengths, dtype=np.intp)
        messages = np.array(held.messages)
        labels = _labels_of(topic, path, messages, lengths)
        orders = list(dict.fromkeys(labels))
        if len(orders) > 1:
            self._table.skipped[f"{name}.{path}"] = (
                "its elements change their order or number: map one by its name"
            )
        for index in range(0 if len(orders) > 1 else int(lengths.max())):
            which, values = held.rows(np.full(len(lengths), index))
            full = f"{name}.{path}[{index}]"
            self._put(full, values, messages[which], clock, order)
            if orders:
                other = f"{name}.{path}[{orders[0][index]}]"
                self._table.columns[other] = self._table.columns[full]
                self._table.clocks[other] = self._table.clocks[full]
        for label in dict.fromkeys(label for found in orders[1:] and orders for label in found):
            place = {found: found.index(label) if label in found else -1 for found in orders}
            which, values = held.rows(np.array([place[found] for found in labels]))
            self._put(f"{name}.{path}[{label}]", values, messages[which], clock, order)


@dataclass(frozen=True)
class _Time:
    """A time or a duration (`is_span`), ns."""

    ns: int
    is_span: bool


_STAMPED = "the clock is header.stamp"
_LOGGED = "the clock is the time of logging, for no header.stamp is in the messages"
_UNSET = "the clock is the time of logging, for header.stamp is not set"
_BACK = "the clock is the time of logging, for header.stamp goes back"
_ELSEWHERE = "the clock is the time of logging, for header.stamp counts on another clock"


def _in_short(error: Exception) -> str:
    return " ".join(str(error).split())[:80]


def _stamps(topic: _Topic, logged: Times, begun: int, ended: int) -> tuple[Times | None, str]:
    """The stamps (n,) ns of a topic's messages, where they can be its clock, and the notice."""
    for name in _STAMPS:
        held = topic.fields.get(name)
        if held is None or held.kind != "times" or len(held.numbers) != len(logged):
            continue
        times = np.array(held.numbers)
        in_order = times[np.argsort(logged, kind="stable")]
        if len(times) > 1 and times.min() == times.max():
            return None, _UNSET
        if np.any(np.diff(in_order) < 0):
            return None, _BACK
        length = ended - begun
        if times.max() < begun - length or times.min() > ended + length:
            return times, _ELSEWHERE
        return times, _STAMPED
    return None, _LOGGED


def _labels_of(
    topic: _Topic, path: str, messages: NDArray[Any], lengths: NDArray[Any]
) -> list[tuple[str, ...]]:
    """The names of an array's elements, message by message; none where they are not known."""
    parent = path.rpartition(".")[0]
    for name in _LABELS:
        found = topic.labels.get(f"{parent}.{name}" if parent else name, [])
        if len(found) != len(topic.logged):
            continue
        mine = [found[number] for number in messages]
        alike = all(len(names) == n for names, n in zip(mine, lengths, strict=True))
        if alike and all(len(set(names)) == len(names) for names in set(mine)):
            return mine
    return []


def _leaves(name: str, value: Any, depth: int) -> Iterator[tuple[str, Any]]:
    """The numbers, arrays, times and texts of a message, with their dotted names."""
    if isinstance(value, bool | np.bool_):
        yield name, int(value)
    elif isinstance(value, float | int | np.number):
        yield name, float(value)
    elif isinstance(value, str | np.ndarray):
        yield name, value
    elif isinstance(value, list | tuple):
        yield from _elements(name, value, depth)
    elif isinstance(value, dict) or dataclasses.is_dataclass(value):
        items = value if isinstance(value, dict) else _attributes(value)
        if (time := _time(name, value, items)) is not None:
            yield name, time
        elif depth < MOST_DEPTH:
            for key, inner in items.items():
                yield from _leaves(f"{name}.{key}" if name else str(key), inner, depth + 1)
    elif isinstance(value, bytes | bytearray | memoryview):
        yield name, np.frombuffer(value, dtype=np.uint8)


def _attributes(message: Any) -> dict[str, Any]:
    """The fields of a message's dataclass, without the name of its type."""
    return {key: value for key, value in vars(message).items() if key != "__msgtype__"}


def _elements(name: str, values: Any, depth: int) -> Iterator[tuple[str, Any]]:
    """A sequence: an array where all are numbers, labels where all are texts, else one by one."""
    kinds = {type(value) for value in values}
    if kinds <= {int, float, bool}:
        yield name, np.array(values, dtype=np.float64)
    elif kinds == {str}:
        yield name, tuple(values)
    elif len(values) > MOST_ELEMENTS:
        yield name, np.empty(len(values), dtype=np.bool_)
    elif depth < MOST_DEPTH:
        for index, value in enumerate(values):
            yield from _leaves(f"{name}[{index}]", value, depth + 1)


def _time(name: str, value: Any, items: dict[str, Any]) -> _Time | None:
    """What {sec, nanosec} and its like mean; None of anything else."""
    keys = set(items)
    if keys not in _SECONDS:
        return None
    seconds, ns = (items[key] for key in sorted(keys, key=lambda key: "n" in key[:1]))
    if not (isinstance(seconds, int | np.integer) and isinstance(ns, int | np.integer)):
        return None
    found = int(seconds) * _NS + int(ns)
    is_span = "duration" in f"{name.rpartition('.')[2]} {type(value).__name__}".lower()
    return _Time(found, is_span) if abs(found) < _MOST_NS else None


__all__ = ["MOST_ELEMENTS", "Messages"]
