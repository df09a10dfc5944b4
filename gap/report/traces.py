"""Measured and simulated signals as files that other viewers show.

    write_traces(result.diagnosis.traces, "traces.mcap")      # Foxglove, PlotJuggler
    write_traces(result.diagnosis.traces, "traces.rrd")       # Rerun
    write_traces(result.diagnosis.traces, "traces.parquet")   # pandas, PlotJuggler

Each has every signal as it was measured, as it was commanded, and as simulated with the model as
given (`before`) and as mended (`after`). Signals are called `recording/joint/signal`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.errors import InputError
from walkerkit.gap.report.diagnosis import Trace

FloatArray = NDArray[np.float64]

_PARTS = ("measured", "before", "after", "target")
_EXTRA = "pip install 'walkerkit[traces]'"


def write_traces(traces: Sequence[Trace], path: str | Path) -> Path:
    """Writes signals to a file.

    Args:
        traces: the signals.
        path: a `.parquet`, `.mcap` or `.rrd` file; one that is there is replaced.

    Returns:
        The file.

    Raises:
        InputError: the ending is another one, or what writes it is not installed.
    """
    path = Path(path)
    check_traces(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    _WRITERS[path.suffix](traces, path)
    return path


def check_traces(path: Path) -> None:
    """Tells whether signals can be written there before the work is done that would be lost.

    Raises:
        InputError: as in `write_traces`.
    """
    if path.suffix not in _WRITERS:
        raise InputError(
            f"{path}: traces are not written as {path.suffix or 'a file without an ending'!r}. "
            f"Give a file that ends in {', '.join(_WRITERS)}."
        )
    try:
        if path.suffix == ".mcap":
            import mcap.writer  # noqa: F401
        elif path.suffix == ".rrd":
            import rerun  # noqa: F401
    except ImportError:
        raise InputError(f"{path}: {path.suffix} is not installed. Do `{_EXTRA}`.") from None


def _parts(trace: Trace) -> Iterator[tuple[str, FloatArray]]:
    for name in _PARTS:
        values = getattr(trace, name)
        if values is not None:
            yield name, values


def _name(trace: Trace) -> str:
    return f"{trace.recording}/{trace.joint}/{trace.signal}"


def _write_parquet(traces: Sequence[Trace], path: Path) -> None:
    import pandas as pd

    frames = [
        pd.DataFrame(
            {
                "recording": trace.recording,
                "joint": trace.joint,
                "signal": trace.signal,
                "unit": trace.unit,
                "held_out": trace.held_out,
                "time": trace.time,
                **dict.fromkeys(_PARTS, np.nan),
                **dict(_parts(trace)),
            }
        )
        for trace in traces
    ]
    pd.concat(frames, ignore_index=True).to_parquet(path, index=False)


def _write_mcap(traces: Sequence[Trace], path: Path) -> None:
    from mcap.writer import Writer

    schema = {
        "type": "object",
        "properties": {name: {"type": "number"} for name in _PARTS},
    }
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(library="walkerkit")
        number = writer.register_schema(
            name="Signal", encoding="jsonschema", data=json.dumps(schema).encode()
        )
        for trace in traces:
            channel = writer.register_channel(
                topic=f"/{_name(trace)}",
                message_encoding="json",
                schema_id=number,
                metadata={"unit": trace.unit, "held_out": str(trace.held_out).lower()},
            )
            parts = dict(_parts(trace))
            for row, time in enumerate(trace.time):
                stamp = round(1e9 * float(time))
                said = {name: float(values[row]) for name, values in parts.items()}
                writer.add_message(
                    channel_id=channel,
                    log_time=stamp,
                    publish_time=stamp,
                    # JSON has no word for what a diverged simulation makes.
                    data=json.dumps(
                        {name: value for name, value in said.items() if math.isfinite(value)}
                    ).encode(),
                )
        writer.finish()  # type: ignore[no-untyped-call]


def _write_rrd(traces: Sequence[Trace], path: Path) -> None:
    import rerun

    stream = rerun.RecordingStream("walkerkit", recording_id=path.stem)
    stream.save(path)
    for trace in traces:
        for name, values in _parts(trace):
            stream.send_columns(
                f"{_name(trace)}/{name}",
                indexes=[rerun.TimeColumn("time", duration=trace.time)],
                columns=rerun.Scalars.columns(scalars=values),
            )
    stream.flush()
    stream.disconnect()


_WRITERS: Mapping[str, Callable[[Sequence[Trace], Path], None]] = MappingProxyType(
    {".parquet": _write_parquet, ".mcap": _write_mcap, ".rrd": _write_rrd}
)
