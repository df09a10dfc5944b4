"""ONNX files, converted and held against ONNX's reference evaluator."""

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper
from onnx.reference import ReferenceEvaluator

from walkerkit.actuators.networks import Mlp, convert_onnx

ACTIVATIONS = {
    "elu": "Elu",
    "relu": "Relu",
    "tanh": "Tanh",
    "softsign": "Softsign",
    "sigmoid": "Sigmoid",
}
RNG = np.random.default_rng(0)
A, B = RNG.normal(size=(2, 6, 6))
W = RNG.normal(size=(6, 3))
C = RNG.normal(size=3)


def node(kind, inputs, output, **attributes):
    return helper.make_node(kind, inputs.split(), [output], name=f"the_{output}", **attributes)


def save(path, nodes, constants, *, inputs=("x",), outputs=("y",), batch="n"):
    graph = helper.make_graph(
        nodes,
        "net",
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, [batch, 6]) for name in inputs],
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, ["n", "m"]) for name in outputs],
        [
            numpy_helper.from_array(np.asarray(array, dtype=np.float32), name)
            for name, array in constants.items()
        ],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.save(model, path)
    return path


def assert_same(mlp, path):
    """To 1e-6 of the largest output, with ONNX in single precision."""
    x = np.random.default_rng(1).normal(size=(200, 6)).astype(np.float32)
    (expected,) = ReferenceEvaluator(str(path)).run(None, {"x": x})
    assert expected.dtype == np.float32
    np.testing.assert_allclose(mlp(x), expected, rtol=0, atol=1e-6 * np.abs(expected).max())


@pytest.fixture
def path(tmp_path):
    return tmp_path / "net.onnx"


@pytest.fixture
def out(tmp_path):
    return tmp_path / "net.npz"


class TestMatches:
    @pytest.mark.parametrize("name", ACTIVATIONS)
    def test_gemm_and_activation(self, path, out, name):
        nodes = [
            node("Gemm", "x a c6", "h", transB=1),
            node(ACTIVATIONS[name], "h", "g"),
            node("Gemm", "g w c", "y"),
        ]
        save(path, nodes, {"a": A, "c6": A[0], "w": W, "c": C})
        mlp = convert_onnx(path, out)
        assert mlp.activations == (name, "identity")
        assert_same(mlp, path)
        assert_same(Mlp.load(out), path)

    @pytest.mark.parametrize("add", ["h c", "c h"])
    def test_matmul_and_add(self, path, out, add):
        nodes = [node("MatMul", "x w", "h"), node("Add", add, "g"), node("Tanh", "g", "y")]
        save(path, nodes, {"w": W, "c": C[None, :]})
        mlp = convert_onnx(path, out)
        assert len(mlp.weights) == 1
        assert_same(mlp, path)

    def test_factors_of_gemm(self, path, out):
        save(path, [node("Gemm", "x w c", "y", alpha=0.5, beta=-2.0)], {"w": W, "c": C})
        assert_same(convert_onnx(path, out), path)

    def test_without_bias(self, path, out):
        nodes = [node("Gemm", "x a", "h"), node("Relu", "h", "g"), node("MatMul", "g w", "y")]
        save(path, nodes, {"a": A, "w": W})
        mlp = convert_onnx(path, out)
        assert not mlp.biases[0].any()
        assert_same(mlp, path)

    def test_softsign_in_three_operations(self, path, out):
        nodes = [
            node("Gemm", "x w c", "h"),
            node("Abs", "h", "a"),
            node("Add", "a one", "b"),
            node("Div", "h b", "y"),
        ]
        save(path, nodes, {"w": W, "c": C, "one": 1.0})
        mlp = convert_onnx(path, out)
        assert mlp.activations == ("softsign",)
        assert_same(mlp, path)

    def test_scales_and_offsets_become_part_of_the_layers(self, path, out):
        nodes = [
            node("Sub", "x m", "a"),
            node("Div", "a s", "b"),
            node("MatMul", "b A", "c"),
            node("Add", "c m", "d"),
            node("Add", "m d", "d2"),
            node("BatchNormalization", "d2 s m m s", "e", epsilon=1e-3),
            node("LeakyRelu", "e", "f", alpha=0.2),
            node("Mul", "two f", "g"),
            node("Gemm", "g w c1", "h"),
            node("Elu", "h", "i", alpha=0.5),
            node("Neg", "i", "j"),
            node("Sub", "two j", "y"),
        ]
        rng = np.random.default_rng(3)
        constants = {"A": A, "w": W, "c1": C, "two": 2.0}
        constants |= {name: rng.uniform(0.5, 1.5, 6) for name in "ms"}
        save(path, nodes, constants)
        mlp = convert_onnx(path, out)
        assert mlp.activations == ("leaky_relu(0.2)", "elu(0.5)", "identity")
        assert_same(mlp, path)

    def test_silu_in_two_operations(self, path, out):
        nodes = [
            node("Gemm", "x w c", "h"),
            node("Sigmoid", "h", "a"),
            node("Mul", "h a", "y"),
        ]
        save(path, nodes, {"w": W, "c": C})
        mlp = convert_onnx(path, out)
        assert mlp.activations == ("silu",)
        assert_same(mlp, path)

    def test_constant_nodes_and_identity(self, path, out):
        weight = numpy_helper.from_array(W.astype(np.float32))
        nodes = [
            helper.make_node("Constant", [], ["w"], value=weight),
            node("Identity", "x", "i"),
            node("Gemm", "i w", "y"),
        ]
        save(path, nodes, {})
        assert_same(convert_onnx(str(path), str(out)), path)

    def test_batch_of_one(self, path, out):
        save(path, [node("Gemm", "x w c", "y")], {"w": W, "c": C}, batch=1)
        assert_same(convert_onnx(path, out), path)


GEMM = node("Gemm", "x a", "h")
REFUSED = {
    "softmax": ([GEMM, node("Softmax", "h", "y")], r"node `the_y` \(Softmax\)"),
    "divided by": ([GEMM, node("Div", "c6 h", "y")], r"\(Div\).*divides by the layer before"),
    "erf": ([GEMM, node("Erf", "h", "y")], r"\(Erf\)"),
    "residual": ([GEMM, node("Add", "h x", "y")], r"\(Add\).*`x` is not constant"),
    "twice": ([GEMM, node("Tanh", "h", "g"), node("Relu", "g", "y")], r"\(Relu\)"),
    "first": ([node("Tanh", "x", "h"), node("Gemm", "h a", "y")], r"\(Tanh\)"),
    "branches": (
        [GEMM, node("Gemm", "x a", "y")],
        r"`the_y` \(Gemm\).*does not work on the layer before it",
    ),
    "transposed": ([node("Gemm", "x a", "y", transA=1)], "transposes its input"),
    "computed": ([node("Gemm", "x x", "y")], "`x` is not constant"),
    "softsign of 2": (
        [GEMM, node("Abs", "h", "p"), node("Add", "p two", "q"), node("Div", "h q", "y")],
        r"`the_q` \(Add\)",
    ),
    "shape": ([GEMM, node("Gemm", "h a3", "y")], r"`weight_1` has shape \(6, 3\)"),
    "bias shape": ([node("Gemm", "x w c6", "y")], r"`bias` has shape \(6,\)"),
    "nothing": ([node("Identity", "x", "y")], "there is no linear layer"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_not_a_chain(path, out, name):
    nodes, message = REFUSED[name]
    constants = {"a": A, "a3": A[:3], "w": W, "c": C, "c6": A[0], "two": 2.0}
    save(path, nodes, constants)
    with pytest.raises(ValueError, match=message) as caught:
        convert_onnx(path, out)
    assert str(caught.value).startswith(f"{path}: ")
    assert not out.exists()


def test_two_inputs(path, out):
    save(path, [node("Gemm", "x w", "y")], {"w": W}, inputs=("x", "z"))
    with pytest.raises(ValueError, match="it takes 2 inputs"):
        convert_onnx(path, out)


def test_two_outputs(path, out):
    nodes = [node("Gemm", "x a", "h"), node("Gemm", "h w", "y")]
    save(path, nodes, {"a": A, "w": W}, outputs=("h", "y"))
    with pytest.raises(ValueError, match="its output is not its last layer's alone"):
        convert_onnx(path, out)


def test_foreign_domain(path, out):
    special = helper.make_node("Gemm", ["x", "w"], ["y"], name="theirs", domain="com.example")
    save(path, [special], {"w": W})
    model = onnx.load(path)
    model.opset_import.append(helper.make_opsetid("com.example", 1))
    onnx.save(model, path)
    with pytest.raises(ValueError, match=r"`theirs` \(Gemm\).*belongs to com\.example"):
        convert_onnx(path, out)


@pytest.mark.parametrize("content", [b"", b"not onnx", b"\x08\x08"])
def test_damaged(path, out, content):
    path.write_bytes(content)
    with pytest.raises(ValueError, match="cannot be read as ONNX"):
        convert_onnx(path, out)


def test_truncated(path, out):
    save(path, [node("Gemm", "x w", "y")], {"w": W})
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(ValueError, match="cannot be read as ONNX"):
        convert_onnx(path, out)


def test_missing(path, out):
    with pytest.raises(FileNotFoundError, match="does not exist"):
        convert_onnx(path, out)
    with pytest.raises(ValueError, match=r"saved as \.npz"):
        convert_onnx(path, out.with_suffix(".pt"))
