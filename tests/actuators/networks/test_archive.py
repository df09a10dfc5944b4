"""Files that are not what they should be."""

import io
import pickle
import zipfile

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.fuzzing.files import bomb
from walkerkit.actuators.networks import Lstm, Mlp, archive

GOOD = {
    "format": np.array("walkerkit.mlp"),
    "version": np.array(1),
    "activations": np.array(["elu", "identity"]),
    "weight_0": np.full((4, 3), 0.5),
    "bias_0": np.zeros(4),
    "weight_1": np.ones((1, 4)),
    "bias_1": np.zeros(1),
}


def npz(arrays):
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


@pytest.fixture
def path(tmp_path):
    return tmp_path / "ankle.npz"


@pytest.fixture(scope="module")
def scratch(tmp_path_factory):
    """One file for all examples of a property."""
    return tmp_path_factory.mktemp("damaged") / "ankle.npz"


def refused(path, content, load=Mlp.load):
    path.write_bytes(content)
    with pytest.raises(ValueError) as caught:
        load(path)
    assert str(caught.value).startswith(f"{path}: ")
    return str(caught.value)


def test_good(path):
    path.write_bytes(npz(GOOD))
    assert Mlp.load(path).n_inputs == 3


class TestDamaged:
    @given(st.integers(0, len(npz(GOOD)) - 1))
    def test_truncated(self, scratch, length):
        assert "should be a complete .npz" in refused(scratch, npz(GOOD)[:length])

    @given(st.integers(0, len(npz(GOOD)) - 1), st.integers(1, 255))
    def test_changed_byte(self, scratch, at, change):
        """Refused, or a byte that the format does not look at."""
        content = bytearray(npz(GOOD))
        content[at] ^= change
        scratch.write_bytes(content)
        try:
            mlp = Mlp.load(scratch)
        except ValueError as error:
            assert str(error).startswith(f"{scratch}: ")  # noqa: PT017
        else:
            assert mlp.activations == ("elu", "identity")
            assert [w.tolist() for w in mlp.weights] == [[[0.5] * 3] * 4, [[1.0] * 4]]

    @pytest.mark.parametrize("content", [b"", b"elu", b"PK\x03\x04", b"\x93NUMPY\x01\x00"])
    def test_something_else(self, path, content):
        assert "should be a complete .npz" in refused(path, content)

    def test_one_array(self, path):
        buffer = io.BytesIO()
        np.save(buffer, np.ones(3))
        assert "one bare array" in refused(path, buffer.getvalue())

    def test_zip_of_something_else(self, path):
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("readme.txt", "hello")
        assert "array `readme.txt` cannot be read" in refused(path, path.read_bytes())

    def test_pytorch_file(self, path):
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("net/data.pkl", b"")
        assert "convert_torch" in refused(path, path.read_bytes())


class Bomb:
    """Would leave a trace if anything unpickled it."""

    def __init__(self, trace):
        self.trace = trace

    def __reduce__(self):
        return (self.trace.write_text, ("unpickled",))


class TestPickled:
    def test_array(self, path, tmp_path):
        trace = tmp_path / "trace"
        objects = np.array([Bomb(trace)], dtype=object)
        message = refused(path, npz(GOOD | {"weight_1": objects}))
        assert "array `weight_1` cannot be read" in message
        assert "nothing pickled" in message
        assert not trace.exists()

    def test_file(self, path, tmp_path):
        trace = tmp_path / "trace"
        assert "nothing pickled" in refused(path, pickle.dumps(Bomb(trace)))
        assert not trace.exists()


class TestBomb:
    @pytest.mark.parametrize("size", [2**29, 2**40, 2**62])
    def test_is_refused_before_it_is_unpacked(self, path, size):
        assert f"asks for {size} bytes" in refused(path, bomb(size))

    def test_an_archive_that_unpacks_to_too_much(self, path, monkeypatch):
        monkeypatch.setattr(archive, "_MOST_BYTES", 100)
        assert "more than the 100 that are read" in refused(path, npz(GOOD))


class TestMissing:
    @pytest.mark.parametrize("load", [Mlp.load, Lstm.load])
    def test_file(self, tmp_path, load):
        with pytest.raises(FileNotFoundError, match=r"nowhere\.npz does not exist"):
            load(tmp_path / "nowhere.npz")
        with pytest.raises(FileNotFoundError, match="is a folder"):
            load(tmp_path)

    @pytest.mark.parametrize("name", GOOD)
    def test_array(self, path, name):
        message = refused(path, npz({k: v for k, v in GOOD.items() if k != name}))
        assert f"array `{name}` is missing" in message

    def test_closest_is_named(self, path):
        arrays = {("weights_0" if k == "weight_0" else k): v for k, v in GOOD.items()}
        assert "(is `weights_0` meant?)" in refused(path, npz(arrays))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"activations": np.array(["elu", "rellu"])}, "is 'rellu': did you mean 'relu'?"),
        ({"activations": np.array(["elu"])}, "no use for `weight_1`, `bias_1`"),
        ({"activations": np.array("elu")}, "array `activations` has dtype <U3 and shape ()"),
        ({"activations": np.array([1, 2])}, "array `activations` has dtype int64"),
        ({"activations": np.array([], dtype=str)}, "no use for `weight_0`"),
        ({"weight_1": np.ones((1, 5))}, "`weight_1` has shape (1, 5), expected (any, 4)"),
        ({"weight_1": np.ones((4, 1))}, "`weight_1` has shape (4, 1), expected (any, 4)"),
        ({"weight_0": np.ones(12)}, "`weight_0` has shape (12,), expected (any, any)"),
        ({"bias_0": np.zeros((4, 1))}, "`bias_0` has shape (4, 1), expected (4)"),
        ({"weight_0": np.ones((4, 3), dtype=int)}, "array `weight_0` has dtype int64"),
        ({"weight_0": np.ones((4, 3), dtype=complex)}, "array `weight_0` has dtype complex128"),
        ({"bias_1": np.zeros(1, dtype=np.longdouble)}, "array `bias_1` has dtype float128"),
        ({"bias_1": np.array(["0"])}, "array `bias_1` has dtype <U1"),
        ({"bias_1": np.array([np.nan])}, "`bias_1`[0] is nan"),
        ({"scale": np.ones(1)}, "no use for `scale`"),
        ({"sca\x1cle": np.ones(1)}, r"no use for `sca\x1cle`"),
        ({"format": np.array("walkerkit.lstm")}, "array `format` is 'walkerkit.lstm'"),
        ({"format": np.array(3)}, "array `format` is 3"),
        ({"version": np.array(2)}, "array `version` is 2, this walkerkit reads 1"),
        ({"version": np.array("1")}, "array `version` is '1'"),
    ],
)
def test_wrong_array(path, change, message):
    assert message in refused(path, npz(GOOD | change))


class TestSaving:
    def test_needs_the_suffix(self, tmp_path):
        mlp = Mlp(weights=[np.ones((1, 1))], biases=[np.ones(1)], activations=["tanh"])
        with pytest.raises(ValueError, match=r"use .*net\.npz"):
            mlp.save(tmp_path / "net.pt")
        assert list(tmp_path.iterdir()) == []

    def test_needs_the_folder(self, tmp_path):
        mlp = Mlp(weights=[np.ones((1, 1))], biases=[np.ones(1)], activations=["tanh"])
        with pytest.raises(FileNotFoundError, match=r"make the folder .*models"):
            mlp.save(tmp_path / "models" / "net.npz")
