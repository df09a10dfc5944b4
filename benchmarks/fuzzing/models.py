"""Models, what lies beside them, command lines, and logs of numbers that nobody expects."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from benchmarks.fuzzing.case import Case, run
from benchmarks.fuzzing.files import _changed
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.simulation.load_robot import load_robot
from walkerkit.gap.simulation.sidecar import with_sidecar
from walkerkit.gap.workflow import compare, diagnose

ARM = """<mujoco model="arm"><compiler angle="radian"/><option timestep="0.005"/><worldbody>
<body name="arm"><joint name="knee" axis="0 1 0" damping="0.1" armature="0.01"/>
<geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.4"/></body></worldbody>
<actuator><position joint="knee" kp="20" kv="0.6"/></actuator></mujoco>"""
_MODEL = {"arm.xml": ARM.encode()}

_ELEMENTS = (
    *("joint", "geom", "body", "site", "inertial", "freejoint", "position", "motor", "mesh"),
    *("texture", "hfield", "include", "replicate", "composite", "default", "compiler", "option"),
    *("size", "general", "keyframe", "key", "equality", "tendon", "sensor", "plugin", "nonsense"),
    *("model", "attach", "frame", "flexcomp", "numeric", "visual", "statistic", "camera"),
)
_ATTRIBUTES = (
    *("name", "type", "size", "pos", "axis", "range", "mass", "joint", "class", "file", "count"),
    *("kp", "gear", "limited", "damping", "armature", "frictionloss", "timestep", "gravity"),
    *("memory", "nsample", "delay", "meshdir", "angle", "quat", "width", "nrow", "fromto", "ref"),
    *(
        "diaginertia",
        "density",
        "ctrlrange",
        "forcerange",
        "solref",
        "solimp",
        "user",
        "childclass",
    ),
)
_VALUES = (
    *("0", "1", "-1", "nan", "inf", "1e308", "-1e308", "1e-308", "0 0 0", "1 0 0", "0 0 -9.81"),
    *("knee", "arm", "", "true", "auto", "mesh", "99999999999", "4G", "../x.obj", "/etc/passwd"),
    *("0 0 0 0", "1 2 3 4 5 6 7 8 9", "hinge", "free", "slide", "a b c", "\u00e9", "arm.xml", "-0"),
)


@st.composite
def _model(draw: st.DrawFn) -> bytes:
    text = ARM
    for _ in range(draw(st.integers(0, 3))):
        attributes = draw(
            st.dictionaries(st.sampled_from(_ATTRIBUTES), st.sampled_from(_VALUES), max_size=3)
        )
        listed = "".join(f' {name}="{value}"' for name, value in attributes.items())
        if draw(st.booleans()):
            # Into an element that is there.
            place = [k for k, char in enumerate(text) if char == "<" and text[k + 1].isalpha()]
            at = draw(st.sampled_from(place))
            end = at + 1
            while text[end].isalnum():
                end += 1
            text = text[:end] + listed + text[end:]
        else:
            tag = draw(st.sampled_from(_ELEMENTS))
            place = [k + 1 for k, char in enumerate(text) if char == ">"]
            at = draw(st.sampled_from(place))
            text = f"{text[:at]}<{tag}{listed}/>{text[at:]}"
    return draw(_changed(text.encode()))


MODELS: st.SearchStrategy[Case] = _model().map(
    lambda content: Case(
        files={"arm.xml": content}, act=lambda folder: load_robot("arm.xml"), place="arm.xml"
    )
)

_JSON = st.recursive(
    st.one_of(
        st.none(),
        st.booleans(),
        st.floats(),
        st.integers(-(10**20), 10**20),
        st.sampled_from(("knee", "position", "arm.xml", "", "linear", "zero_order", "../x")),
    ),
    lambda inner: st.one_of(
        st.lists(inner, max_size=2),
        st.dictionaries(
            st.sampled_from(("knee", "position", "slope", "offset", "nope", "position_delay")),
            inner,
            max_size=2,
        ),
    ),
    max_leaves=4,
)


@st.composite
def _beside(draw: st.DrawFn) -> bytes:
    entry: dict[str, Any] = {
        "hold": "zero_order",
        "command": {"knee": {"position": {"slope": 1.0, "offset": 0.0}}},
        "measurement": {"knee": {"position_delay": 0.004}},
        "laws": {"knee": {"stribeck_friction": {"breakaway": 0.1, "velocity": 0.2}}},
    }
    content: dict[str, Any] = {"schema": 1, "effects": [], "models": {"arm.xml": entry}}
    for _ in range(draw(st.integers(0, 2))):
        at: Any = content if draw(st.integers(0, 3)) == 0 else entry
        for _ in range(draw(st.integers(0, 3))):
            inner = [value for value in at.values() if isinstance(value, dict) and value]
            at = draw(st.sampled_from(inner)) if inner else at
        at[draw(st.sampled_from([*at, "nope"]))] = draw(_JSON)
    return draw(_changed(json.dumps(content).encode()))


SIDECARS: st.SearchStrategy[Case] = st.one_of(
    _beside(), st.integers(1, 100_000).map(lambda depth: b'{"models":' + b"[" * depth)
).map(
    lambda content: Case(
        files=_MODEL | {"actuators.json": content},
        act=lambda folder: with_sidecar(load_robot("arm.xml"), Path("arm.xml")),
        place="actuators.json",
    )
)

_TIME = np.arange(60) * 0.01
_LOG = "\n".join(
    [
        "time,knee/position,knee/position_target",
        *(f"{t:.2f},{0.3 * np.sin(4 * t):.6f},{0.3 * np.sin(4 * t + 0.1):.6f}" for t in _TIME),
    ]
).encode()
_WORDS = (
    *("arm.xml", "log.csv", "experiments.toml", "nowhere.csv", "--window", "--held-out", "--json"),
    *("--threads", "-1", "0", "nan", "1e9", "--effect", "coulomb_friction", "--out", "--nope", ""),
    *("json:loads", ":x", "a:b:c", "-", "--", "\x00", "é", "arm.xml/", ".", "--allow-code", "0.5"),
)
# What ends before the search, which takes minutes, begins.
_REFUSED = {
    "demo": (["--seed", "-1"], ["--hide", "nope"], ["--out", "log.csv"], ["--threads", "x"]),
    "diagnose": (["--out", "log.csv"], ["--effect", "nope"], ["nowhere.csv"], ["--window", "-1"]),
    "simulate": (["--seconds", "0"], ["--hide", "nope"], ["--seed", "-1"], ["--seconds", "nan"]),
}


@st.composite
def _arguments(draw: st.DrawFn) -> tuple[str, ...]:
    command = draw(
        st.sampled_from(
            ("compare", "compare", "diagnose", "demo", "simulate", "effects", "", "nope")
        )
    )
    words = draw(st.lists(st.sampled_from(_WORDS), max_size=4))
    if command in ("compare", "diagnose", "simulate") and draw(st.booleans()):
        words = ["arm.xml", *words] if command == "simulate" else ["arm.xml", "log.csv", *words]
    if command in _REFUSED and "--help" not in words:
        words += draw(st.sampled_from(_REFUSED[command]))
    return (command, *words)


COMMANDS: st.SearchStrategy[Case] = _arguments().map(
    lambda arguments: Case(
        files={
            **_MODEL,
            "log.csv": _LOG,
            "experiments.toml": b'[[experiment]]\nmodel = "arm.xml"\nrecordings = ["log.csv"]\n',
        },
        act=lambda folder: run(*arguments),
    )
)

_SHAPES = {
    "swing": 0.3 * np.sin(4 * _TIME),
    "still": np.full(60, 0.2),
    "far": np.full(60, 49.0),
    "steps": 0.4 * np.sign(np.sin(9 * _TIME)),
    "noise": np.random.default_rng(0).normal(0, 2, 60),
    "tiny": 1e-300 * np.arange(60),
    "spike": np.where(np.arange(60) == 30, 49.0, 0.0),
    "wraps": (9 * _TIME + np.pi) % (2 * np.pi) - np.pi,
    "huge": np.full(60, 1e300) * np.sign(np.sin(9 * _TIME)),
    "large": 1e6 * np.sin(9 * _TIME),
}
_ANGLES = tuple(name for name in _SHAPES if name not in ("huge", "large"))


@st.composite
def _log(draw: st.DrawFn) -> Mapping[str, NDArray[np.float64]]:
    length = draw(st.sampled_from((2, 19, 20, 21, 60)))
    step = draw(st.sampled_from((1e-6, 0.001, 0.01, 0.1, 0.19)))
    columns = {
        "time": np.arange(length) * step + draw(st.sampled_from((0.0, 1.7e9))),
        "knee/position": _SHAPES[draw(st.sampled_from(_ANGLES))][:length],
        "knee/position_target": _SHAPES[draw(st.sampled_from(_ANGLES))][:length],
    }
    for signal in draw(st.sets(st.sampled_from(("velocity", "effort", "effort_target")))):
        columns[f"knee/{signal}"] = _SHAPES[draw(st.sampled_from(sorted(_SHAPES)))][:length]
    return columns


def _recording(name: str, columns: Mapping[str, NDArray[np.float64]]) -> Recording:
    signals = dict(columns)
    return Recording(name=name, time=signals.pop("time"), columns=signals)


def _compared(log: Mapping[str, NDArray[np.float64]]) -> Case:
    def act(folder: Path) -> object:
        return compare("arm.xml", [_recording("log", log)], n_threads=1).to_json()

    return Case(files=_MODEL, act=act)


@st.composite
def _diagnosed(draw: st.DrawFn) -> Case:
    logs = draw(st.lists(_log(), min_size=1, max_size=3))
    effects = draw(
        st.lists(st.sampled_from(sorted(CATALOGUE)), min_size=1, max_size=3, unique=True)
    )

    def act(folder: Path) -> object:
        recordings = [_recording(f"log {k}", log) for k, log in enumerate(logs)]
        result = diagnose("arm.xml", recordings, effects=effects, n_threads=1)
        return result.diagnosis.to_json()

    return Case(files=_MODEL, act=act)


COMPARISONS: st.SearchStrategy[Case] = _log().map(_compared)
DIAGNOSES: st.SearchStrategy[Case] = _diagnosed()
